// Codes of the box in the operator's words, each with an icon, so that colour is never alone in saying it.

export const LEVELS = {
  good: { word: "Ready", icon: "accept" },
  fair: { word: "Usable", icon: "warning" },
  poor: { word: "Not yet", icon: "cross" },
  none: { word: "No pipe", icon: "cross" },
};

export const CAMERAS = {
  up: { word: "working", state: "good", icon: "accept" },
  starting: { word: "starting", state: "fair", icon: "warning" },
  degraded: { word: "troubled", state: "fair", icon: "warning" },
  lost: { word: "lost", state: "bad", icon: "cross" },
};

export const CLOCKS = {
  none: { word: "Clock not set", state: "fair", icon: "warning" },
  browser: { word: "Clock set by a browser", state: "good", icon: "accept" },
  rtc: { word: "Clock from the box's battery", state: "good", icon: "accept" },
  ntp: { word: "Clock from the network", state: "good", icon: "accept" },
};

// What matters of the box itself, for the top bar.
export const SHORT = {
  under_voltage: "Low voltage",
  was_under_voltage: "Was low voltage",
  too_hot: "Too hot",
  hot: "Hot",
  slowed: "Slowed down",
  memory_low: "Memory low",
  usb_slow: "Slow USB",
  hotspot_silent: "Hotspot silent",
  not_recorded: "Not recorded",
};

export function age(seconds) {
  if (seconds === null || !Number.isFinite(seconds)) return "never";
  if (seconds < 10) return `${seconds.toFixed(1)} s`;
  if (seconds < 120) return `${Math.round(seconds)} s`;
  return `${Math.round(seconds / 60)} min`;
}

export const millimetres = (value) => (value === null || value === undefined ? "–" : value.toFixed(0));

export const percent = (share) => (share === null || share === undefined ? "–" : `${Math.round(100 * share)} %`);

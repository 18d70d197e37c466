// Landmarks in words: where, how sure, what. Lengths in metres, clock positions in hours in (0, 12].

export const STATUSES = { candidate: "candidate", confirmed: "confirmed", passed: "passed" };
const SYMBOLS = ["connection", "deposit", "displaced joint", "fracture", "roots"];
export const NOTHING = "false"; // the belief that there is nothing at all

// What the network was taught: of these there are heatmaps.
export const inNetwork = (name) => SYMBOLS.includes(name);
export const slug = (name) => (SYMBOLS.includes(name) ? name.replaceAll(" ", "-") : "other");
export const symbol = (name) => `lm-${slug(name)}`;
export const className = (name) => (name === NOTHING ? "nothing there" : name);
export const sentence = (text) => text.charAt(0).toUpperCase() + text.slice(1);

// As it now counts: the measured values with the operator's corrections on top; an extent moves as a whole.
export function shown(landmark) {
  const { class: label, chainage_m: at, clock } = landmark.corrected ?? {};
  const length = Math.max(landmark.chainage_to_m - landmark.chainage_m, 0);
  const from = at ?? landmark.chainage_m;
  const begins = clock ?? landmark.clock;
  const reach = landmark.clock === null || landmark.clock === undefined ? 0 : clockReach(landmark.clock, landmark.clock_to);
  return {
    ...landmark,
    class: label ?? landmark.class,
    chainage_m: from,
    chainage_to_m: from + length,
    clock: begins ?? null,
    clock_to: begins === null || begins === undefined ? null : wrapHour(begins + reach),
    reach,
    rejected: landmark.decision === "rejected",
  };
}

export const wrapHour = (hour) => {
  const rest = ((hour % 12) + 12) % 12;
  return rest === 0 ? 12 : rest;
};

// Hours from one clock position to another, clockwise. Measured ends may swap by rounding: nearly a whole turn is none.
export function clockReach(from, to) {
  const reach = (((to ?? from) - from) % 12 + 12) % 12;
  return reach > 11.5 ? 0 : reach;
}

// "2:00", "12:25": to five minutes, which is finer than anything is measured.
export function clockText(hour) {
  if (hour === null || hour === undefined) return "–";
  const minutes = (Math.round((hour * 60) / 5) * 5) % 720;
  return `${Math.floor(minutes / 60) || 12}:${String(minutes % 60).padStart(2, "0")}`;
}

export const metresText = (value, digits = 2) => (value === null || value === undefined ? "–" : value.toFixed(digits));

const LEAST_LENGTH_M = 0.1;
const LEAST_REACH_H = 0.25;

export function chainageText({ chainage_m: from, chainage_to_m: to }) {
  return to - from >= LEAST_LENGTH_M ? `${metresText(from)} to ${metresText(to)} m` : `${metresText((from + to) / 2)} m`;
}

export function whereText(view) {
  if (view.clock === null) return "clock not known";
  return view.reach >= LEAST_REACH_H ? `${clockText(view.clock)} to ${clockText(view.clock_to)}` : clockText(wrapHour(view.clock + view.reach / 2));
}

export const sigmaText = (metres) => (metres === null || metres === undefined ? "" : metres < 0.0995 ? `± ${(metres * 100).toFixed(metres < 0.00995 ? 1 : 0)} cm` : `± ${(metres * 100).toFixed(0)} cm`);

// Of a long thing the end that is known less well; maps of earlier versions state one sigma for both.
export const sigmaOf = ({ sigma_chainage_m: from, sigma_chainage_to_m: to }) => (from === null ? null : Math.max(from, to ?? from));

export const isExtent = (view) => view.chainage_to_m - view.chainage_m >= LEAST_LENGTH_M || view.reach >= LEAST_REACH_H;

export const seenText = ({ hits, misses }) => `${hits} ${hits === 1 ? "hit" : "hits"}, ${misses} ${misses === 1 ? "miss" : "misses"}`;

// One line for screen readers and titles.
export const spoken = (view) => `${sentence(view.class)} at ${chainageText(view)}, ${view.clock === null ? "" : "clock "}${whereText(view)}, ${view.rejected ? "rejected" : view.status}`;

// The choices of a clock position, every half hour from 12.
export const HALF_HOURS = Array.from({ length: 24 }, (_, half) => wrapHour(half / 2));

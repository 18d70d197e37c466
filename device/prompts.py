"""What the box tells the operator: for every reason to refuse, what is wrong and what to do, one plain sentence each."""

from __future__ import annotations

from dataclasses import asdict, dataclass


@dataclass(frozen=True)
class Prompt:
    """``reason`` says what is wrong, ``remedy`` what to do."""

    code: str
    reason: str
    remedy: str

    def to_json(self) -> dict[str, str]:
        """As the page wants it."""
        return asdict(self)


PROMPTS = {
    prompt.code: prompt
    for prompt in (
        Prompt("no_pipe", "No pipe is in view.", "Lower the box to the pipe and point the camera into it."),
        Prompt(
            "few_points",
            "The camera sees too little of the wall.",
            "Clean the window, give it light, and keep 20 cm off the wall.",
        ),
        Prompt(
            "aim",
            "The camera does not look along the pipe.",
            "Turn the box until the pipe is round in the picture, with wall on all sides.",
        ),
        Prompt("shape", "The pipe is not round here.", "Measure at a sound place, or order the lining by width and height."),
        Prompt(
            "motion",
            "The box moved during the measurement.",
            "Rest the box on the invert or hold the rod still, then measure again.",
        ),
        Prompt(
            "unstable",
            "The diameter changes from try to try.",
            "Clean the window, move the box a hand's breadth and measure again.",
        ),
        Prompt(
            "wide_interval",
            "The diameter is not known well enough to order a lining.",
            "Move further into the pipe so that more wall is seen, and measure again.",
        ),
        Prompt(
            "water",
            "Water or deposit hides the lower part of the pipe.",
            "Stop the flow or raise the box so that more of the wall is seen.",
        ),
        Prompt(
            "camera_lost",
            "The camera stopped sending pictures.",
            "Wait for it to come back, or check its cable, then measure again.",
        ),
        Prompt(
            "second_position",
            "A pipe this wide needs a second measurement.",
            "Move the box to the middle of the pipe and press Measure again.",
        ),
        Prompt(
            "slip",
            "The counter stands still but the picture moves.",
            "Pull the cable taut and see that the counter's wheel turns with it.",
        ),
        Prompt(
            "image_stands",
            "The counter runs but the picture stands still.",
            "Stop, take up the slack cable, and see whether the crawler is stuck.",
        ),
        Prompt("too_fast", "The crawler drives too fast to follow the wall in the picture.", "Drive more slowly."),
        Prompt("too_dark", "The picture is too dark.", "Turn up the crawler's lights, or drive until they reach the wall."),
        Prompt("too_bright", "The picture is over-exposed.", "Turn down the crawler's lights, or move on from the wall."),
        Prompt("dirty_lens", "Something sticks to the lens.", "Bring the crawler back and clean the lens."),
        Prompt("off_axis", "The camera does not look along the pipe.", "Turn the camera straight ahead and centre it."),
        Prompt("signal_lost", "The CCTV picture is lost.", "Stop until it is back; check the camera and its cable."),
        Prompt(
            "encoder_lost",
            "The tether encoder is silent, so nothing is mapped.",
            "Stop the crawler until the counter is back, and check its cable.",
        ),
        Prompt(
            "no_distance",
            "The distance in the picture cannot be read.",
            "Move the text to a dark place, or use an encoder.",
        ),
        Prompt(
            "under_voltage",
            "The box gets too little voltage.",
            "Charge or change the power bank, and use a short, thick cable.",
        ),
        Prompt(
            "was_under_voltage",
            "The box had too little voltage since it was switched on.",
            "Use a short, thick cable, and watch the power bank.",
        ),
        Prompt("too_hot", "The box is too hot and slows down.", "Take it out of the sun, or switch it off for ten minutes."),
        Prompt("hot", "The box is getting hot.", "Take it out of the sun and let air to it."),
        Prompt("slowed", "The computer of the box has slowed itself down.", "Let it cool, and look after its power supply."),
        Prompt("disk_low", "The disk is nearly full.", "Take the recordings to a laptop and delete the oldest."),
        Prompt("memory_low", "The memory of the box is nearly used up.", "Restart the box when the survey is over."),
        Prompt(
            "usb_slow",
            "A depth camera is connected at USB 2 speed.",
            "Plug it into a blue socket, with its own cable, and all the way in.",
        ),
        Prompt("clock_unset", "The box does not know the date.", "Open this page on a phone: the box takes its time."),
        Prompt(
            "hotspot_silent",
            "The hotspot of the box is silent and is being restarted.",
            "Wait a minute; the box goes on measuring meanwhile.",
        ),
        Prompt(
            "not_recorded",
            "The raw data of this survey is no longer recorded; findings still are.",
            "Go on; free some space, or see to the disk, before the next one.",
        ),
        Prompt(
            "map_contradicted",
            "Something speaks against this map: do not rely on it.",
            "End or cancel the survey and begin again, slowly, keeping the structure in view.",
        ),
        Prompt(
            "adrift",
            "The box no longer knows well where it is.",
            "Go back to where pipes are in view that it has seen before.",
        ),
        Prompt("few_scans", "There are too few scans for a map.", "Go around the whole structure before you end the survey."),
        Prompt("no_structure", "No pipes of the expected size were found.", "Check the pipes' radius in the settings."),
        Prompt("scanner_lost", "The scanner is lost.", "Check its cable and its power; the survey waits."),
        Prompt("dvl_lost", "The DVL is lost: the position drifts where no known pipe is in view.", "Check its cable."),
        Prompt("ahrs_lost", "The AHRS is lost: scans are left out.", "Check its cable; hold still until it is back."),
        Prompt("pressure_lost", "The pressure sensor is lost.", "Check its cable; the survey goes on without the depth."),
        Prompt("pair_dark", "The stereo pictures are too dark.", "Turn the projector or the lamp on, or bring more light."),
        Prompt("pair_bright", "The stereo pictures are over-exposed.", "Turn the light down, or move back from the wall."),
        Prompt("pair_blurred", "The stereo pictures are out of focus.", "Clean the lenses, and focus a metre ahead."),
        Prompt("pair_near", "The wall is too near for both cameras to see it.", "Move back, at least 20 cm from the wall."),
        Prompt("pair_aside", "The camera stands far from the middle of the pipe.", "Bring it nearer to the pipe's axis."),
        Prompt(
            "pair_too_smooth",
            "The wall is too smooth: it shows too little texture to be measured.",
            "Turn the projector on, or add light from the side.",
        ),
        Prompt(
            "pair_no_match",
            "The two pictures have too little in common.",
            "See that both lenses are clean and look into the pipe, then scan again.",
        ),
        Prompt("pair_no_wall", "No wall of a pipe is in view.", "Look along the pipe, with wall on all sides of the picture."),
        Prompt("pair_too_short", "Too short a piece of the wall is seen.", "Move back, or look straight along the pipe."),
        Prompt("pair_one_sided", "Too little of the way around the pipe is seen.", "Look along the pipe, from its middle."),
        Prompt(
            "pair_not_smooth",
            "Too much lies off any smooth profile: this is no sound pipe.",
            "Scan at another place, and look at the picture here.",
        ),
        Prompt("pair_moved", "The camera moved during the scan.", "Hold it still until the pairs are taken, then scan again."),
        Prompt("pair_lost", "The stereo camera sends no pictures.", "Check its cables, or wait for it to come back."),
        Prompt("storage_full", "The disk is full: the map is no longer saved.", "End the drive, then free some space."),
    )
}

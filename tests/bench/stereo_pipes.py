"""Real stereo pairs (figures 1 and 2 of the anomaly survey): what is fitted, sizes of known pipes, scores of both ends, and the
published way beside ours. ``--sheet FILE.png`` draws every pair with its deviations; ``--cache DIR`` keeps the reference's
disparities and scores (13 s of processor time each) between runs; ``--without-reference`` leaves it out."""

from __future__ import annotations

import argparse
import json
import os
import time
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.stats import spearmanr

from device.anomaly.picture import deviation_overlay
from device.anomaly.result import inspect
from drivers.stereo.replay import PairEntry, PairFolder, pair_folder, read_pair
from estimators.anomaly.pair import PairFindings
from estimators.radial_profile.shape import shape_of
from estimators.stereo.follow import follow_wall
from estimators.stereo.known_pipe import rig_from_known_pipe
from estimators.stereo.rig import StereoRig
from tests.bench.real_data import fail
from tests.bench.stereo_reference import PAPER_BAND_PX, ReferencePair, reference_pair
from tests.bench.table import print_table

SMOOTH = ("L1", "M2", "M4", "N1", "R500", "E400600")
"""New pipes with little texture."""
TILE = 480, 300
NEAR = 0.05
"""A depth within this share of the radius of the fitted wall lies on it or on something that is told from it."""


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--sheet", type=Path)
    parser.add_argument("--cache", type=Path)
    parser.add_argument("--without-reference", action="store_true")
    parser.add_argument("--pairs", nargs="*", help="only pairs whose name begins like one of these")
    options = parser.parse_args()
    cv2.setNumThreads(1)
    root = os.environ.get("BORESCOUT_DATA")
    if not root or not (Path(root) / "stereo_pipes" / "manifest.json").is_file():
        fail("Set BORESCOUT_DATA to the folder of the shared recordings (it holds stereo_pipes).")
    folder = pair_folder(Path(root) / "stereo_pipes")
    rig = StereoRig(folder.intrinsics, folder.baseline_m, None)
    rows, tiles = [], []
    scores: dict[tuple[str, str], float] = {}
    references: dict[tuple[str, str], float] = {}
    same_band: dict[tuple[str, str], float] = {}
    shares, noises, ours_seconds, their_seconds = [], [], [], []
    chosen = [entry for entry in folder.pairs if not options.pairs or name(entry).startswith(tuple(options.pairs))]
    for entry in chosen:
        frame = read_pair(folder, entry)
        begun = time.process_time()
        result, findings = inspect(frame.left, frame.right, rig)
        seconds = time.process_time() - begun
        ours_seconds.append(seconds)
        reference = None if options.without_reference else cached_reference(frame.left, frame.right, entry, options.cache)
        if reference is not None and reference.score is not None:
            references[entry.pipe, entry.end] = reference.score
        if reference is not None:
            their_seconds.append(sum(reference.seconds))
        tiles.append(overlay(frame.left, name(entry), result["message"], findings))
        if findings is None:
            rows.append((name(entry), "no", *"-" * 7, result["reason"]))
            continue
        scores[entry.pipe, entry.end] = findings.inward
        theirs = "-"
        if reference is not None:
            share, noise = beside(findings, reference)
            shares.append(share)
            theirs = f"{100 * share[1]:.1f} %"
            same_band[entry.pipe, entry.end] = score_in_band(findings)
            if entry.pipe == "R500" and noise is not None:
                noises.append((name(entry), *noise))
        rows.append(
            (
                name(entry),
                "yes",
                f"{findings.followed.wall.harmonics}",
                f"{result['score_mm']:.2f}",
                f"{result['outward_mm']:.2f}",
                f"{result['width_mm'] or '-'}",
                f"{result['height_mm'] or '-'}",
                f"{100 * findings.followed.coverage:.1f} %",
                theirs,
                f"{len(result['regions'])} regions, {seconds:.2f} s",
            )
        )
        print(f"\r{len(rows)} of {len(chosen)}", end="", flush=True)
    header = ("pair", "fitted", "K", "in mm", "out mm", "W mm", "H mm", "coverage", "reference", "")
    print_table("Each pair alone: no range, no calibration", header, rows)
    fitted = sum(row[1] == "yes" for row in rows)
    print(f"\nfitted: {fitted} of {len(rows)}; the reference with the paper's fixed band: {len(references)} of {len(rows)}")
    if shares:
        ours, theirs, our_near, their_near = 100 * np.mean(shares, axis=0)
        print(f"wall pixels with a trusted depth: {ours:.1f} %, the reference's: {theirs:.1f} %, {ours - theirs:.1f} points")
        near = f"{our_near:.1f} %, the reference's {their_near:.1f} %, {our_near - their_near:.1f} points"
        print(f"of them within {100 * NEAR:.0f} % of the radius of the wall: {near}")
        both = f"ours {np.mean(ours_seconds):.2f} s, reference {np.mean(their_seconds):.2f} s"
        print(f"processor time a pair: {both} (cached matching counts nothing)")
    if noises:
        print_table("Residual noise on pixels that both matched, mm", ("pair", "ours", "reference"), noises)
    print_table(
        "Both ends of a pipe: rank correlation of their scores",
        ("", "pipes", "Spearman", "95 %"),
        both_ends(scores, references),
    )
    agreement(scores, references, "its own band each")
    ceiling(scores, references)
    agreement(same_band, references, "the reference's band")
    known_sizes(folder)
    if options.sheet is not None:
        save_sheet(tiles, options.sheet)
        print(f"overlays: {options.sheet}")


def name(entry: PairEntry) -> str:
    return f"{entry.pipe} {entry.end}"


def cached_reference(left: NDArray[np.uint8], right: NDArray[np.uint8], entry: PairEntry, cache: Path | None) -> ReferencePair:
    """The reference on a pair, or what ``cache`` keeps of it: disparities, score and times, without the deviations."""
    stem = Path(entry.left).stem.removesuffix("_L")
    disparities, rest = (None if cache is None else cache / f"{stem}{end}" for end in (".npy", ".json"))
    known = np.load(disparities) if disparities is not None and disparities.is_file() else None
    if known is not None and rest is not None and rest.is_file():
        told = json.loads(rest.read_text())
        return ReferencePair(known, None, told["score_m"], (told["matching_s"], told["rest_s"]))
    found = reference_pair(left, right, disparity=known)
    if cache is not None and disparities is not None and rest is not None:
        cache.mkdir(parents=True, exist_ok=True)
        if known is None:
            np.save(disparities, found.disparity)
        rest.write_text(json.dumps({"score_m": found.score, "matching_s": found.seconds[0], "rest_s": found.seconds[1]}))
    return found


def score_in_band(findings: PairFindings) -> float:
    """Eq. 18 (m) over the same pixels as the reference's: those between the paper's two disparities; nan where there are none.
    Each counts once, as there."""
    followed = findings.followed
    low, high = PAPER_BAND_PX
    deviation = findings.points.deviation
    counted = np.isfinite(deviation) & (followed.disparity > low) & (followed.disparity < high)
    weight = followed.grid.pixels[counted].astype(np.float64)
    if weight.sum() <= 0:
        return float("nan")
    return float(weight @ np.maximum(-deviation[counted].astype(np.float64), 0.0) / weight.sum())


def beside(
    findings: PairFindings, reference: ReferencePair
) -> tuple[tuple[float, float, float, float], tuple[str, str] | None]:
    """(shares of the same wall's pixels, residual noise in mm of both on the pixels that both have).

    The shares: ours with a trusted depth, the reference's with any, since it states no confidence, and of either those that are
    within NEAR of the wall, which a wrong match hardly is. The noise of both is the robust spread about the same wall, ours.
    """
    followed = findings.followed
    grid, wall = followed.grid, followed.wall
    column, row = np.round(grid.x).astype(np.float32), np.round(grid.y).astype(np.float32)
    theirs = cv2.remap(reference.disparity, column, row, cv2.INTER_NEAREST, borderValue=(float("nan"),))
    visible = followed.ends.inside & grid.seen
    matched = visible & np.isfinite(theirs)
    both = matched & followed.match.trusted
    met = wall.meet(grid.u, grid.v, np.broadcast_to(grid.depth[:, None], grid.u.shape))
    predicted = (wall.rig.offset_px or 0.0) + wall.rig.range_px_m / met
    shift = grid.disparity - (wall.rig.offset_px or 0.0)
    scale = 1000 * wall.profile(grid.theta)[0] / shift
    shares, spread = [], []
    for disparity, known in ((followed.disparity, visible & followed.match.trusted), (theirs, matched)):
        near = known & (np.abs(np.nan_to_num(disparity) - predicted) < NEAR * shift)
        shares.append([float(grid.pixels[cells].sum() / grid.pixels[visible].sum()) for cells in (known, near)])
        residual = ((disparity - predicted) * scale)[both]
        spread.append(f"{1.4826 * float(np.median(np.abs(residual - np.median(residual)))):.2f}")
    noise = (spread[0], spread[1]) if np.count_nonzero(both) >= 1000 else None
    return (shares[0][0], shares[1][0], shares[0][1], shares[1][1]), noise


def both_ends(
    scores: dict[tuple[str, str], float], references: dict[tuple[str, str], float]
) -> list[tuple[str, int, str, str]]:
    rows = []
    pipes = [pipe for pipe, end in scores if end == "Front" and (pipe, "Back") in scores]
    common = [pipe for pipe in pipes if (pipe, "Front") in references and (pipe, "Back") in references]
    for label, values, which in (
        ("ours, all", scores, pipes),
        ("ours, same pipes", scores, common),
        ("reference", references, common),
    ):
        if len(which) < 4:
            continue
        front = np.array([values[pipe, "Front"] for pipe in which])
        back = np.array([values[pipe, "Back"] for pipe in which])
        rows.append((label, len(which), f"{spearmanr(front, back).statistic:.2f}", interval(front, back)))
    return rows


def interval(one: NDArray[np.float64], other: NDArray[np.float64]) -> str:
    """95 % by bootstrap over pipes."""
    rng = np.random.default_rng(0)
    found = []
    for _ in range(1000):
        pick = rng.integers(len(one), size=len(one))
        if len(np.unique(pick)) > 2:
            found.append(spearmanr(one[pick], other[pick]).statistic)
    low, high = np.nanpercentile(found, [2.5, 97.5])
    return f"{low:.2f} to {high:.2f}"


def agreement(scores: dict[tuple[str, str], float], references: dict[tuple[str, str], float], where: str) -> None:
    rows = []
    common = [key for key in scores if key in references and np.isfinite(scores[key])]
    for label, keys in (("all", common), ("well textured", [key for key in common if key[0] not in SMOOTH])):
        if len(keys) >= 4:
            one, other = np.array([scores[key] for key in keys]), np.array([references[key] for key in keys])
            rows.append((label, len(keys), f"{spearmanr(one, other).statistic:.2f}", interval(one, other)))
    if rows:
        print_table(
            f"Our score against the reference's, pairs that both fitted: {where}", ("", "pairs", "Spearman", "95 %"), rows
        )


def ceiling(scores: dict[tuple[str, str], float], references: dict[tuple[str, str], float]) -> None:
    """What two scores of the same pipes can agree in at most: no score agrees with another more than with itself, and two are
    expected to agree in the root of the product of how each repeats itself (Spearman's attenuation). Means of both ends repeat
    themselves better: 2 r / (1 + r)."""
    both = {pipe for pipe, end in references if end == "Front" and (pipe, "Back") in references}
    pipes = sorted(pipe for pipe in both if (pipe, "Front") in scores and (pipe, "Back") in scores)
    if len(pipes) < 4:
        return
    ends = [np.array([[side[pipe, end] for pipe in pipes] for end in ("Front", "Back")]) for side in (scores, references)]
    repeats = [max(float(spearmanr(front, back).statistic), 0.0) for front, back in ends]
    means = [2 * one / (1 + one) for one in repeats]
    rows = []
    for label, chosen, agreed in (
        ("each end", np.hstack, repeats),
        ("mean of both ends", lambda side: side.mean(axis=0), means),
    ):
        ours, theirs = (chosen(side) for side in ends)
        most = f"{np.sqrt(agreed[0] * agreed[1]):.2f}"
        rows.append((label, len(ours), f"{spearmanr(ours, theirs).statistic:.2f}", interval(ours, theirs), most))
    header = ("", "scores", "Spearman", "95 %", "expected of two scores of one thing")
    print_table("Our score against the reference's, on pipes that both fitted from both ends", header, rows)


def known_sizes(folder: PairFolder) -> None:
    """R500 from one end tells offset and scale; the other end and the egg are measured with them."""
    entries = {(entry.pipe, entry.end): entry for entry in folder.pairs}
    rows = []
    for end in ("Front", "Back"):
        if ("R500", end) not in entries:
            continue
        frame = read_pair(folder, entries["R500", end])
        left, right = (cv2.cvtColor(picture, cv2.COLOR_BGR2GRAY) for picture in (frame.left, frame.right))
        rig = StereoRig(folder.intrinsics, folder.baseline_m, None)
        followed = follow_wall(left, right, rig, np.random.default_rng(6))
        shape = shape_of(followed.wall, followed.usable.any(axis=0), followed.grid.theta)
        known = rig_from_known_pipe(followed, shape.fitted_width if shape.width is None else shape.width.value, 0.5)
        told = StereoRig(
            folder.intrinsics,
            folder.baseline_m * known.scale,
            known.offset_px,
            known.offset_std_px,
            known.scale_std,
            known.shift_px,
        )
        for pipe, other, truth in (("R500", "Back" if end == "Front" else "Front", 500), ("E400600", "Front", 400)):
            if (pipe, other) not in entries:
                continue
            frame = read_pair(folder, entries[pipe, other])
            result = inspect(frame.left, frame.right, told)[0]
            width, within = result["width_mm"], result["width_interval_mm"]
            error = "-" if width is None else f"{100 * (width / truth - 1):+.1f} %"
            between = "-" if within is None else f"{within[0]:.0f} to {within[1]:.0f}"
            seen = f"{result['height_mm'] or '-'} ({result['seen_height_mm']:.0f} seen)" if result["fitted"] else "-"
            rows.append((f"R500 {end}", f"{known.offset_px:.1f}", f"{pipe} {other}", truth, f"{width}", error, between, seen))
    header = ("calibrated on", "offset px", "measured", "true W", "W mm", "error", "95 %", "height mm")
    print_table("Pipes of known size, offset and scale from one end of R500", header, rows)


def overlay(left: NDArray[np.uint8], title: str, message: str, findings: PairFindings | None) -> NDArray[np.uint8]:
    """The left picture with the deviation on it: red inwards, blue outwards, full at 10 mm; the wall's ends in yellow."""
    small = cv2.resize(left, TILE, interpolation=cv2.INTER_AREA)
    if findings is not None:
        small = deviation_overlay(small, left.shape[1] / TILE[0], findings)
    cv2.putText(small, title + (": " + message if message else ""), (6, 16), cv2.FONT_HERSHEY_SIMPLEX, 0.45, (0, 255, 255), 1)
    return np.asarray(small, np.uint8)


def save_sheet(tiles: list[NDArray[np.uint8]], path: Path, across: int = 5) -> None:
    while len(tiles) % across:
        tiles.append(np.zeros_like(tiles[0]))
    cv2.imwrite(str(path), np.vstack([np.hstack(tiles[start : start + across]) for start in range(0, len(tiles), across)]))


if __name__ == "__main__":
    main()

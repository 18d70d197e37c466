"""Every benchmark, one after the other: ``make bench``, or ``python -m tests.bench [--quick]``."""

from __future__ import annotations

import argparse
import subprocess
import sys
import time

BENCHMARKS: tuple[tuple[str, tuple[str, ...], tuple[str, ...]], ...] = (
    ("real_frames", (), ()),
    ("proxies", (), ("--frames", "8")),
    ("noise_fit", (), ()),
    ("paper_sweep", (), ()),
    ("cost", (), ()),
    ("peers", (), ("--frames", "5")),
    ("landmark_segment", (), ("--seeds", "2")),
    ("landmark_cost", (), ("--frames", "300")),
    ("osd", (), ("--searches", "3")),
    ("cctv_run", (), ()),
    ("rings", (), ("--seeds", "2", "--metres", "5")),
    ("foe", (), ("--seeds", "2")),
    ("virtual_map", (), ("--seconds", "20")),
    ("drive_cost", (), ("--frames", "200", "--runs", "2")),
    ("drive_faults", (), ("--drives", "2")),
    ("landmark_smoothing", (), ("--runs", "8")),
    ("landmark_smoothing_peers", (), ()),
    ("fcdd_boxes", (), ()),
    ("fcdd_cost", (), ("--rounds", "15")),
    ("fcdd_virtual", ("--every", "2"), ("--only", "connections", "--drives", "2")),
    ("api_schema", (), ("--examples", "3")),
    ("intrusion", (), ()),
    ("hostile", (), ("--seconds", "3")),
    ("phones", (), ("--rounds", "2", "--seconds", "8")),
    ("unattended", (), ("--tour", "two")),
    ("real_chain", (), ()),
    (
        "crash",
        ("--rounds", "1"),
        ("--rounds", "1", "--samples", "50", "--kills", "20", "--points", "10", "--flips", "20", "--daemon-kills", "0"),
    ),
    ("start", (), ("--runs", "2")),
    ("sensor_faults", (), ("--faults", "12")),
    ("deliverables", (), ()),
    ("batch", (), ("--recordings", "10", "--scaling", "4")),
    ("replay", (), ("--rounds", "1", "--seconds", "10", "--surveys", "1", "--damages", "20")),
    ("structure_recognition", ("--seeds", "3"), ("--seeds", "1", "--rate", "0.02")),
    ("stereo_pipes", (), ("--without-reference", "--pairs", "R500", "E400600", "F1")),
    ("anomaly_virtual", (), ("--scenes", "6", "--clean", "6", "--smooth", "2")),
    ("anomaly_roots", (), ("--scenes", "2")),
    ("anomaly_joints", (), ("--pairs", "6")),
    ("stereo_cost", (), ("--pairs", "F1 Back")),
    ("structure_slam", ("--seeds", "3", "--fault-seeds", "1"), ("--seeds", "1", "--fault-seeds", "1")),
    ("structure_cvfh", (), ("--clouds", "10")),
    ("structure_cost", (), ("--scans", "3")),
)
"""Name, arguments of the whole run, arguments of a quick one."""


def main() -> None:
    parser = argparse.ArgumentParser(prog="python -m tests.bench", description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--quick", action="store_true", help="fewer frames: minutes instead of half an hour")
    quick = parser.parse_args().quick
    failed = []
    for name, whole, short in BENCHMARKS:
        command = [sys.executable, "-m", f"tests.bench.{name}", *(short if quick else whole)]
        print(f"\n=== {' '.join(command[1:])}", flush=True)
        started = time.perf_counter()
        if subprocess.run(command).returncode != 0:
            failed.append(name)
        print(f"    ({time.perf_counter() - started:.0f} s)", flush=True)
    if failed:
        print(f"\nWithout figures: {', '.join(failed)}", file=sys.stderr)
        raise SystemExit(1)


if __name__ == "__main__":
    main()

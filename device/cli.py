"""The command line. What goes wrong is said in one sentence on stderr, with exit status 2."""

from __future__ import annotations

import importlib
import logging
import os
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any, ClassVar, TypeVar

# Before numpy is loaded: a second BLAS thread costs memory and gains nothing here, see workers.py.
for _name in ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ.setdefault(_name, "1")

import click  # noqa: E402 - see above

from device.errors import DeviceError, Invalid  # noqa: E402 - see above
from drivers.base import DriverError  # noqa: E402 - see above

F = TypeVar("F", bound=Callable[..., Any])

EXIT_BAD_INPUT = 2
EXIT_INTERRUPTED = 130


class LazyCommands(click.Group):
    """Commands that are loaded when they are asked for: ``--help`` must not wait for OpenCV on a small computer."""

    lazy: ClassVar = {
        "anomaly": ("device.anomaly.command:anomaly", "See where a pipe's wall deviates, from stereo."),
        "calibrate": ("device.calibrating.command:calibrate", "Calibrate a stereo rig."),
        "batch": ("device.batch.command:batch", "Convert a folder of inspections."),
        "demo-inspection": ("device.export.command:demo", "Put a complete virtual inspection into the store."),
        "doctor": ("device.doctor:doctor", "Look at everything the box needs."),
        "export": ("device.export.command:export_inspection", "Write an inspection in the formats of the trade."),
        "fcdd": ("device.fcdd.command:fcdd", "Train, export and judge the detector of landmarks."),
        "label": ("device.label:label", "Print the label of the box: Wi-Fi, page and PIN."),
        "map": ("device.landmarks.command:map_pipe", "Map a pipe from CCTV and tether."),
        "measure": ("device.diameter.command:measure", "Measure the diameter of a pipe."),
        "recordings": ("device.recorder.command:recordings", "List, check, recover, prune, export raw data of surveys."),
        "replay": ("device.replay.command:replay_recording", "Compute a recorded survey again and compare."),
        "serve": ("device.serve_command:serve", "Run the box: read the cameras, serve the page."),
        "structure": ("device.structure.command:structure", "Map a pipe structure from scans and navigation."),
        "virtual-campaign": ("device.campaign:virtual_campaign", "Measure many virtual pipes and count the errors."),
    }
    """Name: (module:command, what ``--help`` says of it)."""

    def list_commands(self, ctx: click.Context) -> list[str]:
        """Their names."""
        return sorted(self.lazy)

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:
        """The command, loaded now."""
        if cmd_name not in self.lazy:
            return None
        module, attribute = self.lazy[cmd_name][0].split(":")
        command: click.Command = getattr(importlib.import_module(module), attribute)
        return command

    def format_commands(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        """The list in ``--help``, without loading them."""
        with formatter.section("Commands"):
            formatter.write_dl([(name, about) for name, (_, about) in sorted(self.lazy.items())])


@click.group(cls=LazyCommands, invoke_without_command=True, context_settings={"help_option_names": ["-h", "--help"]})
@click.version_option(package_name="borescout", message="borescout %(version)s")
@click.option("-v", "--verbose", is_flag=True, help="Log what happens to stderr.")
@click.pass_context
def cli(context: click.Context, verbose: bool) -> None:
    """Measures and maps sewer pipes so that nobody has to climb into them."""
    talkative = verbose or context.invoked_subcommand == "serve"
    logging.basicConfig(
        level=logging.INFO if talkative else logging.ERROR,
        format="%(asctime)s %(levelname)s %(name)s: %(message)s",
        stream=sys.stderr,
    )
    if context.invoked_subcommand is None:
        click.echo(context.get_help())


def camera_options(command: F) -> F:
    """--virtual, --replay and --camera, with what belongs to them."""
    for option in (
        click.option("--config", type=click.Path(path_type=Path), help="Settings file (TOML)."),
        click.option("--data-dir", type=click.Path(path_type=Path, file_okay=False), help="Where findings are kept."),
        click.option(
            "--camera",
            "cameras",
            type=click.Choice(["realsense", "oak"]),
            multiple=True,
            help="Use this camera; name two to use both at once.",
        ),
        click.option("--tof", is_flag=True, help="With --virtual: a time-of-flight camera beside the stereo one."),
        click.option(
            "--description", type=click.Path(path_type=Path), help="With --virtual: JSON file of the sewer and its faults."
        ),
        click.option("--virtual", is_flag=True, help="Look into the virtual sewer."),
        click.option("--replay", type=click.Path(path_type=Path), help="Play a folder with a manifest, a .db3 or a .bag."),
    ):
        command = option(command)
    return command


def chosen_cameras(
    virtual: bool, tof: bool, description: Path | None, replay: Path | None, cameras: tuple[str, ...]
) -> dict[str, Any]:
    """The camera options as settings; empty where none was given. Raises Invalid for a mixture."""
    if sum((virtual, replay is not None, bool(cameras))) > 1:
        raise Invalid("Choose one of --virtual, --replay and --camera.")
    if (tof or description is not None) and not virtual:
        raise Invalid(f"The option {'--tof' if tof else '--description'} goes with --virtual.")
    if len(set(cameras)) < len(cameras):
        raise Invalid("The same --camera was named twice.")
    if virtual:
        return {"cameras": ("virtual",), "virtual_cameras": 2 if tof else 1, "virtual_description": description}
    if replay is not None:
        return {"cameras": ("replay",), "replay": replay}
    return {"cameras": cameras} if cameras else {}


def main(arguments: list[str] | None = None) -> None:
    """The entry point: exit status 0 done, 1 done with faults, 2 could not, 130 interrupted."""
    sys.exit(_run(arguments))


def _run(arguments: list[str] | None) -> int:
    try:
        status = cli.main(arguments, prog_name="borescout", standalone_mode=False)
    except click.ClickException as error:
        _say(error.format_message())
        return EXIT_BAD_INPUT
    except (DeviceError, DriverError) as error:
        _say(str(error))
        return EXIT_BAD_INPUT
    except (click.Abort, KeyboardInterrupt):
        _say("Interrupted.")
        return EXIT_INTERRUPTED
    except BrokenPipeError:  # whoever read stdout has seen enough; nothing more can be said there
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 0
    return status if isinstance(status, int) else 0


def _say(sentence: str) -> None:
    click.echo(f"borescout: {sentence}", err=True)


if __name__ == "__main__":
    main()

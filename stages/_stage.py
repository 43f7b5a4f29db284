"""What every stage shares: Hydra composes, the schema validates, the tracker opens, then the stage runs.

    @stage("collect", CollectConfig)
    def run(cfg: CollectConfig, out: Path, track: Tracker) -> None: ...

    if __name__ == "__main__":
        run()

`out` is Hydra's output folder, the only place a stage writes to. A `P2LError`, and any mistake on the command line, is
one message on standard error and exit code 2, with nothing left behind. A failing job of a sweep leaves its siblings
alone.
"""

from __future__ import annotations

import functools
import io
import logging
import os
import re
import shlex
import signal
import sys
import traceback
from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeVar, cast

import hydra
from hydra.core.hydra_config import HydraConfig
from hydra.errors import HydraException
from hydra.types import RunMode
from omegaconf import DictConfig, OmegaConf
from omegaconf.errors import OmegaConfBaseException
from yaml import YAMLError  # type: ignore[import-untyped]

from p2l.artifacts import config_hash, write_text
from p2l.errors import P2LError
from p2l.manifest import check_place, write_manifest
from p2l.schema import StageConfig, paths_of, resolve, validate
from p2l.text import printable
from p2l.tracking import RunCard, Tracker, safe_uri, start
from stages import ROOT, begin
from stages._place import CONFIG_FILE, LOG_FILE, Stamps, alone, claim, clear, release, stamps, written
from stages._stdout import listen
from stages._wording import told_apart

ConfigT = TypeVar("ConfigT", bound=StageConfig)
StageFunction = Callable[[ConfigT, Path, Tracker], None]
FinishedCheck = Callable[[ConfigT, Path], str | None]

STOPPED_VARIABLE = "P2L_STOPPED"  # says to what ends at exit that this process was stopped
PARENT_VARIABLE = "P2L_PARENT_RUN"
_ALWAYS = ("hydra.output_subdir=null", "hydra/job_logging=none")  # this module keeps the config and the log


def _identity(_root_: DictConfig) -> str:
    """Hash of a configuration, for the folder of a stage that goes on where it was stopped."""
    plain = cast(dict[str, Any], OmegaConf.to_container(_root_, resolve=False))
    return config_hash({key: value for key, value in plain.items() if key not in ("hydra", "tracking")})


OmegaConf.register_new_resolver("identity", _identity, replace=True)


class Terminated(BaseException):
    """SIGTERM, as a scheduler sends it; like `KeyboardInterrupt`, it ends what goes on and lets it tidy up."""


_STOPS: dict[type[BaseException], tuple[str, int]] = {KeyboardInterrupt: ("Ctrl-C", 130), Terminated: ("SIGTERM", 143)}


class JobError(Exception):
    """A job ended in an error that it has already reported; crosses process borders."""

    def __init__(self, code: int) -> None:
        super().__init__(code)
        self.code = code


def stage(
    name: str, schema: type[ConfigT], finished: FinishedCheck[ConfigT] | None = None, record: str | None = None
) -> Callable[[StageFunction[ConfigT]], Callable[[], None]]:
    """Make a function the stage `name`, whose configuration is `conf/<name>.yaml` and obeys `schema`.

    `finished` says, before anything is written, what to tell of a run that is there already instead of running it; with
    the file `record` in its folder, a stage goes on with the tracked run.
    """

    def decorate(function: StageFunction[ConfigT]) -> Callable[[], None]:
        @functools.wraps(function)
        def job(config: DictConfig) -> None:
            _job(name, schema, function, config, finished, record)

        entry = hydra.main(config_path=str(ROOT / "conf"), config_name=name, version_base="1.3")(job)

        @functools.wraps(function)
        def main() -> None:
            sys.exit(_command_line(name, schema, entry))

        return main

    return decorate


def _command_line(name: str, schema: type[StageConfig], entry: Callable[[], Any]) -> int:
    """Run Hydra on the command line; returns the exit code."""
    os.environ["HYDRA_FULL_ERROR"] = "1"  # else Hydra reports errors in its own way and exits with 1
    command = safe_uri(shlex.join(["python", "-m", f"stages.{name}", *sys.argv[1:]]))
    sys.argv[1:] = _arguments(sys.argv[1:], paths_of(schema) | {"hydra.run.dir"})
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):  # an ASCII terminal is no reason to fail after the work is done
            stream.reconfigure(errors="backslashreplace")
    listen()
    begin()
    signal.signal(signal.SIGTERM, _terminate)
    try:
        entry()
    except JobError as failure:
        return failure.code
    except (KeyboardInterrupt, Terminated) as stop:  # a job says more
        by, code = _STOPS[type(stop)]
        os.environ[STOPPED_VARIABLE] = by
        print(f"stage {name}: stopped by {by}. To run it again:\n  {command}", file=sys.stderr)
        return code
    except (HydraException, OmegaConfBaseException, YAMLError, ValueError, OSError) as error:  # a job reports its own
        told = printable(_one_message(told_apart(error, schema)))
        print(f"stage {name}: {told}\nSee `python -m stages.{name} --help`.", file=sys.stderr)
        return P2LError.exit_code
    return 0


def _arguments(words: list[str], paths: frozenset[str]) -> list[str]:
    """Options first, since Hydra wants the overrides together; a config path counts from the working folder."""
    options: list[str] = []
    overrides: list[str] = []
    for word in words:
        if options and options[-1] in ("-cp", "--config-path"):
            options.append(str(Path(word).resolve()))
        elif word.startswith("--config-path="):
            options.append(f"--config-path={Path(word.partition('=')[2]).resolve()}")
        else:
            (overrides if re.match(r"[^-].*=|~", word) else options).append(word)
    if not {"-m", "--multirun"} & set(options):  # in a sweep a comma separates values
        overrides = [_plain_path(word, paths) for word in overrides]
    keys = {word.partition("=")[0] for word in overrides}
    return options + overrides + [always for always in _ALWAYS if always.partition("=")[0] not in keys]


def _plain_path(word: str, paths: frozenset[str]) -> str:
    """A person's file as the shell gave it, quoted where Hydra's grammar would read more than a path into it.

    What is written for Hydra stays: quotes, escapes, interpolations and null.
    """
    key, _, value = word.partition("=")
    if key not in paths or value in ("", "null") or value[0] in "'\"" or "\\" in value or "${" in value:
        return word
    path = os.path.expanduser(value)  # noqa: PTH111 (the shell leaves a ~ after = alone; Path fails without a home)
    if re.fullmatch(r"[\w./-]+", path, re.ASCII):
        return f"{key}={path}"
    literal = path.replace("'", "\\'")
    return f"{key}='{literal}'"


def _one_message(error: BaseException) -> str:
    lines = [line.strip() for line in str(error).splitlines() if line.strip()]
    if error.__cause__ is not None and (cause := str(error.__cause__).splitlines()):
        lines.append(f"({cause[0]})")
    return "\n  ".join(dict.fromkeys(lines))


def _job(
    name: str,
    schema: type[ConfigT],
    function: StageFunction[ConfigT],
    config: DictConfig,
    finished: FinishedCheck[ConfigT] | None,
    record: str | None,
) -> None:
    """One run, alone or in a sweep; reports its own errors, then ends the process or, in a sweep, raises `JobError`."""
    settings = HydraConfig.get()
    out = Path(settings.runtime.output_dir)
    sweep = settings.mode == RunMode.MULTIRUN
    title = f"stage {name} [{' '.join(settings.overrides.task)}]" if sweep else f"stage {name}"
    failure = JobError if sweep else SystemExit  # Hydra lets the jobs after a JobError run, and adds words to it
    before = stamps(out)
    _log_to(out)
    try:
        with alone(out):
            _run(name, schema, function, config, out, finished, record)
    except P2LError as error:
        _clear(out, before)
        print(f"{title}: {printable(str(error))}", file=sys.stderr)
        raise failure(error.exit_code) from None
    except OSError as error:
        if error.filename is None or not Path(os.fsdecode(error.filename)).is_relative_to(out):
            _report_unexpected(title)
            raise failure(1) from None
        print(f"{title}: {printable(str(error.filename))}: cannot be written ({error.strerror})", file=sys.stderr)
        raise failure(P2LError.exit_code) from None
    except (KeyboardInterrupt, Terminated, Exception) as error:
        if (stop := _stop_behind(error)) is not None:
            by, code = _STOPS[type(stop)]
            os.environ[STOPPED_VARIABLE] = by
            print(f"{title}: stopped by {by}. {_what_goes_on(name, out, before)}", file=sys.stderr)
            raise SystemExit(code) from None
        _report_unexpected(title)
        raise failure(1) from None


def _report_unexpected(title: str) -> None:
    print(f"{title}: unexpected error\n{traceback.format_exc()}", file=sys.stderr)


def _terminate(number: int, frame: object) -> None:  # noqa: ARG001
    raise Terminated


def _stop_behind(error: BaseException | None) -> BaseException | None:
    """The stop behind an error: a library that is stopped while it is imported raises an error of its own."""
    while error is not None and type(error) not in _STOPS:
        error = error.__cause__ or error.__context__
    return error


def _what_goes_on(name: str, out: Path, before: Stamps) -> str:
    """What a stopped job has left, and the command that goes on from it."""
    left = written(out, before)
    if not left:
        _clear(out, before)
    place, command = os.path.relpath(out), safe_uri(_command(name))
    if not left:
        return f"Nothing is kept. To begin again:\n  {command}"
    if "hydra.run.dir=" not in command:
        command += f" {shlex.quote(f'hydra.run.dir={place}')}"
    return f"What is finished is kept in {place}. To go on from there:\n  {command}"


def _run(
    name: str,
    schema: type[ConfigT],
    function: StageFunction[ConfigT],
    config: DictConfig,
    out: Path,
    finished: FinishedCheck[ConfigT] | None,
    record: str | None,
) -> None:
    cfg = validate(resolve(config), schema, "configuration")
    check_place(out)
    if finished is not None and (message := finished(cfg, out)):
        print(message)
        return
    claim(name, out)
    plain = cfg.model_dump(mode="json")
    plain["tracking"]["uri"] = cfg.tracking.uri and safe_uri(cfg.tracking.uri)
    card = RunCard(
        stage=name,
        world=cfg.subject,
        method=cfg.method,
        seed=cfg.seed,
        config={key: value for key, value in plain.items() if key != "tracking"},
        config_hash=cfg.hash,
        command=safe_uri(_command(name)),
        parent=os.environ.get(PARENT_VARIABLE),
        goes_on=record is not None and (out / record).is_file(),
    )
    with start(card, out, ROOT, enabled=cfg.tracking.enabled, uri=cfg.tracking.uri) as track:
        function(cfg, out, track)
        write_text(out / CONFIG_FILE, OmegaConf.to_yaml(OmegaConf.create(plain)))
        write_manifest(out, frozenset({CONFIG_FILE}))
        release(out)
    print(f"stage {name}: outputs in {os.path.relpath(out)}")


def _command(name: str) -> str:
    """The command that runs this job again, alone."""
    settings = HydraConfig.get()
    words = ["python", "-m", f"stages.{name}"]
    [source] = [entry.path for entry in settings.runtime.config_sources if entry.provider == "main"]
    more = [entry.path for entry in settings.runtime.config_sources if entry.provider == "command-line"]
    words += [word for path in more for word in ("--config-dir", os.path.relpath(path))]
    if Path(source) != ROOT / "conf":
        words += ["-cp", os.path.relpath(source), "-cn", str(settings.job.config_name)]
    run_dir = [word for word in settings.overrides.hydra if word.startswith("hydra.run.dir=")]
    return shlex.join([*words, *settings.overrides.task, *run_dir])


def _log_to(out: Path) -> None:
    """Log to standard error and, from the first message on, to `out/stage.log`."""
    screen, file = logging.StreamHandler(), logging.FileHandler(out / LOG_FILE, delay=True)
    logging.basicConfig(
        level=logging.INFO, format="%(asctime)s %(name)s: %(message)s", handlers=[screen, file], force=True
    )
    for chatty in ("alembic", "mlflow.store.db.utils", "matplotlib", "numba", "git", "OpenGL"):
        logging.getLogger(chatty).setLevel(logging.WARNING)


def _clear(out: Path, before: Stamps) -> None:
    logging.basicConfig(handlers=[logging.StreamHandler()], force=True)
    clear(out, before)

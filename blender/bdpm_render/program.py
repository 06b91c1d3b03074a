"""The program bdpm: where it is, whether it is new enough, and a render of its under way."""

import importlib.util
import json
import os
import shutil
import signal
import subprocess
import sys
import sysconfig
import threading
from pathlib import Path

NAME = "bdpm.exe" if sys.platform == "win32" else "bdpm"
# What this add-on needs of the program, as its help says it.
NEEDED = ("--progress", "--view", "--layers", "--no-denoise")
ADVICE = (
    "Install its Python wheel or build it from its source (cargo build --release), then give its path in "
    "Preferences > Add-ons > BDPM, or put it on the PATH"
)
KEPT_LINES = 40


class ProgramError(Exception):
    """The program cannot be run; says what to do."""


def find(preferred):
    """The program: as the preferences say, beside this file, on the PATH, or where pip installs it.

    Raises ProgramError if there is none."""
    if preferred:
        path = Path(preferred).expanduser()
        if path.is_dir():
            path = path / NAME
        if not path.is_file():
            raise ProgramError(f"There is no program {path}. Correct its path in Preferences > Add-ons > BDPM")
        return str(path)
    beside = Path(__file__).parent / "bin" / NAME
    found = str(beside) if beside.is_file() else shutil.which(NAME) or _installed_by_pip()
    if not found:
        raise ProgramError(f"The program bdpm was not found. {ADVICE}")
    return found


def _installed_by_pip():
    """The program of the Python package bdpm, of Blender's own Python or of the user; None if there is none."""
    package = importlib.util.find_spec("bdpm")
    places = [Path(folder) / "bin" for folder in package.submodule_search_locations or ()] if package else []
    # Desktops start Blender without this folder on the PATH.
    places.append(Path(sysconfig.get_path("scripts", sysconfig.get_preferred_scheme("user"))))
    return next((str(place / NAME) for place in places if (place / NAME).is_file()), None)


_checked = {}


def check(path):
    """Returns the version. Raises ProgramError if it does not run, or is older than this add-on."""
    state = os.stat(path)
    key = (path, state.st_mtime_ns, state.st_size)
    if key not in _checked:
        _checked[key] = _version(path)
    return _checked[key]


def _version(path):
    def said(*arguments):
        try:
            done = subprocess.run([path, *arguments], capture_output=True, timeout=20, env=environment(), **_window())
        except (OSError, subprocess.TimeoutExpired) as error:
            raise ProgramError(f"{path} does not run: {error}. {ADVICE}") from None
        if done.returncode:
            lines = done.stderr.decode(errors="replace").strip().splitlines()
            raise ProgramError(f"{path} does not run: {lines[-1] if lines else 'it says nothing'}. {ADVICE}")
        return done.stdout.decode(errors="replace")

    version, text = said("--version").strip(), said("render", "--help")
    if not version.startswith("bdpm"):
        raise ProgramError(f"{path} is another program: it says `{version[:60]}`. {ADVICE}")
    missing = [option for option in NEEDED if option not in text]
    if missing:
        raise ProgramError(f"{path} ({version}) is older than this add-on: it has no {missing[0]}. {ADVICE}")
    return version


def environment():
    """Variables of the program: Blender's own libraries are not for it."""
    kept = dict(os.environ)
    if "LD_LIBRARY_PATH" in kept and os.path.isdir(os.path.join(os.path.dirname(sys.executable), "lib")):
        del kept["LD_LIBRARY_PATH"]
    return kept


def _window():
    if sys.platform == "win32":
        flags = subprocess.CREATE_NEW_PROCESS_GROUP | subprocess.CREATE_NO_WINDOW
        return {"creationflags": flags}
    # Signals of the terminal that Blender was started from are for Blender.
    return {"start_new_session": True}


class Render:
    """A render under way."""

    def __init__(self, path, arguments, cwd):
        self.status = {}
        self.notes = []
        self._lines = []
        try:
            self._process = subprocess.Popen(
                [path, "render", *arguments, "--progress", "json"],
                cwd=cwd,
                env=environment(),
                stdin=subprocess.DEVNULL,
                stdout=subprocess.PIPE,
                stderr=subprocess.PIPE,
                **_window(),
            )
        except OSError as error:
            raise ProgramError(f"{path} does not run: {error}. {ADVICE}") from None
        self._answer = b""
        self._threads = [threading.Thread(target=read, daemon=True) for read in (self._read_log, self._read_answer)]
        for thread in self._threads:
            thread.start()

    def _read_log(self):
        for line in self._process.stderr:
            text = line.decode(errors="replace").strip()
            if text.startswith("{"):
                try:
                    self.status = json.loads(text)
                    continue
                except ValueError:
                    pass  # a line like others
            if text:
                self._lines = self._lines[-KEPT_LINES:] + [text]
            if text.startswith(("note:", "warning:")):
                self.notes.append(text)

    def _read_answer(self):
        self._answer = self._process.stdout.read()

    @property
    def said(self):
        """The last line that is no progress."""
        return self._lines[-1] if self._lines else ""

    def is_running(self):
        return self._process.poll() is None

    def interrupt(self):
        """Asks it to finish the iteration and to write what there is."""
        if self.is_running():
            # Programs that a shell starts in the background ignore SIGINT, and so do those that they start.
            self._process.send_signal(signal.CTRL_BREAK_EVENT if sys.platform == "win32" else signal.SIGTERM)

    def kill(self):
        if self.is_running():
            self._process.kill()

    def finish(self):
        """Waits for its end; what it answered. Raises ProgramError with its own words if it failed."""
        code = self._process.wait()
        for thread in self._threads:
            thread.join(timeout=5)
        for pipe in (self._process.stdout, self._process.stderr):
            pipe.close()
        if code == 0:
            return json.loads(self._answer or b"{}")
        raise ProgramError(self._problem(code))

    def _problem(self, code):
        at = next((i for i, line in enumerate(self._lines) if line.startswith("error:")), None)
        if at is not None:
            return "\n".join(self._lines[at:]).removeprefix("error: ")
        last = f" Its last words: {self.said}" if self.said else ""
        if code < 0:
            try:
                name = signal.Signals(-code).name
            except ValueError:
                name = f"signal {-code}"
            advice = "; there may be too little memory" if name == "SIGKILL" else ""
            return f"bdpm was ended by {name}{advice}.{last}"
        return f"bdpm ended with status {code}.{last}"

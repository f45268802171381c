"""Start and stop a recording: by the vendor's SDK where it is installed, else by the user's hand."""

import sys
import threading
import time
from collections.abc import Callable
from pathlib import Path
from typing import Literal, Protocol

from evsdr.errors import InputError
from evsdr.rig.camera_settings import CameraSettings, set_up

SETTLE_S = 0.3  # before and after the ring's run, so that no trigger is missed
QUIET_S = 2.0  # a file that has not grown for so long is complete
PATIENCE_S = 600.0

Control = Literal["auto", "sdk", "manual"]


class Camera(Protocol):
    """A camera that records."""

    def start(self, path: Path) -> None:
        """Start the recording, into that file if the program can choose it."""

    def growing(self, path: Path) -> Path | None:
        """Give the file that grows while it records into that file; None if nobody knows."""

    def stop(self) -> Path:
        """End the recording; give its file."""

    def abandon(self) -> None:
        """End the recording after a failure."""


def open_camera(
    control: Control,
    recording: Path | None = None,
    serial: str = "",
    settings: CameraSettings = CameraSettings(),
) -> Camera:
    """Give the camera's control.

    Parameters
    ----------
    control : "auto", "sdk" or "manual"
        Auto takes the SDK if it is installed and no file is named.
    recording : Path, optional
        File that the user's own software will write.
    serial : str
        Serial number; the first camera if empty.
    settings : CameraSettings
        What the SDK shall set.

    Raises
    ------
    InputError
        The SDK is asked for but not installed, or needed by the settings.
    """
    by_hand = control == "manual" or (control == "auto" and recording)
    if by_hand and settings != CameraSettings():
        raise InputError(
            "--bias, --region and --event-rate are set by the vendor's SDK; set them in your own software."
        )
    if by_hand:
        return ManualCamera(recording)
    try:
        import metavision_hal
    except ImportError as error:
        if control == "auto" and settings == CameraSettings():
            return ManualCamera(recording)
        raise InputError(
            f"--camera sdk: the package metavision_hal of the vendor's SDK can't be imported ({error}); "
            "install it, or leave --camera out and press record by hand."
        ) from error
    return SdkCamera(metavision_hal, serial, settings)


class SdkCamera:
    """A camera under the vendor's SDK (Metavision or OpenEB); its main trigger input is switched on.

    Parameters
    ----------
    hal : module
        metavision_hal.
    serial : str
        Serial number; the first camera if empty.
    settings : CameraSettings
        What is set before it records.

    Attributes
    ----------
    told : dict
        What the camera says of itself, see `camera_settings.set_up`; empty before it starts.
    """

    def __init__(self, hal, serial: str = "", settings: CameraSettings = CameraSettings()):
        self._hal, self._serial, self._settings = hal, serial, settings
        self.told: dict = {}
        self._done = threading.Event()
        self._is_lost = False

    def start(self, path: Path) -> None:
        """Open the camera and let it record into a RAW file."""
        try:
            self._device = self._hal.DeviceDiscovery.open(self._serial)
            if self._device is None:
                raise RuntimeError("none found")
            trigger = self._device.get_i_trigger_in()
            if trigger is None or not trigger.enable(self._hal.I_TriggerIn.Channel.MAIN):
                raise RuntimeError("no trigger input")
            self.told = set_up(self._hal, self._device, self._settings)
            self._stream = self._device.get_i_events_stream()
            self._path, self._growing = path, self.growing(path)
            if not self._stream.log_raw_data(str(self._growing)):
                raise RuntimeError(f"can't write {path}")
            self._stream.start()
        except (RuntimeError, OSError) as error:  # what the SDK's exceptions become
            raise InputError(
                f"the camera can't be started ({error}); plug it in and close other programs."
            ) from error
        self._thread = threading.Thread(target=self._drain, daemon=True)
        self._thread.start()
        time.sleep(SETTLE_S)

    def growing(self, path: Path) -> Path:
        """Give the file that grows while it records into that file."""
        return path.with_name(f".{path.name}")

    def stop(self) -> Path:
        """End the recording; give its file."""
        time.sleep(SETTLE_S)
        self._end()
        if self._is_lost:
            self._growing.unlink(missing_ok=True)
            raise InputError("the camera stopped sending during the run; check its cable and record again.")
        return self._growing.replace(self._path)

    def abandon(self) -> None:
        """End the recording, remove its file."""
        self._end()
        self._growing.unlink(missing_ok=True)

    def _end(self) -> None:
        self._done.set()
        self._thread.join()
        self._stream.stop_log_raw_data()
        self._stream.stop()

    def _drain(self) -> None:
        """Take the data from the camera, which writes them to the file."""
        while not self._done.is_set():
            state = self._stream.poll_buffer()
            if state < 0:
                self._is_lost = True
                return
            if state:
                self._stream.get_latest_raw_data()
            else:
                time.sleep(1e-3)


class ManualCamera:
    """A camera that the user starts and stops in other software.

    Parameters
    ----------
    recording : Path, optional
        File that the software will write; asked for if None.
    ask : callable (text) -> str
        Show a text and wait for a line.
    quiet_s : float
        Time without growth after which the file is complete [s].
    """

    def __init__(self, recording: Path | None, ask: Callable[[str], str] = input, quiet_s: float = QUIET_S):
        self._recording, self._quiet_s = recording, quiet_s
        self._ask = ask

    def start(self, path: Path) -> None:
        """Ask the user to record."""
        self._size_before = self._size()
        self._line("Switch the camera's trigger input on and press record now; then press Enter here: ")

    def growing(self, path: Path) -> Path | None:
        """Give the file that the software will write, if it was told."""
        return self._recording

    def stop(self) -> Path:
        """Ask the user to stop, wait until the file is complete."""
        if self._recording is None:
            text = self._line("Stop the recording now; then type the path of its file: ")
            return Path(text.strip().strip("'\"")).expanduser()
        print(f"Stop the recording now; waiting for {self._recording} to be complete.", file=sys.stderr)
        begin = quiet_since = time.monotonic()
        size = self._size()
        while time.monotonic() - begin < PATIENCE_S:
            time.sleep(self._quiet_s / 20)
            if (now := self._size()) != size:
                size, quiet_since = now, time.monotonic()
            elif size and size != self._size_before and time.monotonic() - quiet_since > self._quiet_s:
                return self._recording
        raise InputError(
            f"{self._recording}: no new recording came in {PATIENCE_S / 60:.0f} minutes; check the path and "
            "join it later by python -m evsdr.convert."
        )

    def abandon(self) -> None:
        """Tell the user."""
        print("Stop the recording; it is of no use.", file=sys.stderr)

    def _size(self) -> int:
        return self._recording.stat().st_size if self._recording and self._recording.is_file() else 0

    def _line(self, text: str) -> str:
        try:
            return self._ask(text)
        except EOFError as error:
            raise InputError(
                "nobody answers at the keyboard; run the command in a terminal, or use the vendor's SDK."
            ) from error

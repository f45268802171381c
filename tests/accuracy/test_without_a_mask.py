"""A thing of unknown shape before darkness, and no mask that tells its pixels: it is fitted as well as with one."""

import pytest

import evsdr
from evsdr.effects.outline import Outline
from tests.support.small_scene import camera, scene

PLANE = (
    '<shape type="rectangle" id="object"><transform name="to_world"><scale value="2"/></transform></shape>'
)
FAST = evsdr.Settings(preset="fast", gloss="off")
pytestmark = pytest.mark.filterwarnings("ignore::evsdr.InputWarning")  # maps that are wrong are warned of


def test_the_dark_around_a_thing_tells_nothing_of_it(tmp_path, monkeypatch):
    """If it is not left out, silence passes for thresholds that are large, and reflectances follow."""
    from evsdr.fitting import deciding  # which needs the backend

    true, told = tmp_path / "true.xml", tmp_path / "told.xml"
    small = camera(width=48, height=48, wide=2.0)
    true.write_text(scene(sensor=small))
    told.write_text(scene(sensor=small, shape=PLANE))
    recording, truth = evsdr.simulate(evsdr.load_scene(true), rounds=4, seed=3, thresholds="nominal")
    told = evsdr.load_scene(told)

    def errors(mask=None):
        return evsdr.score(evsdr.fit(told, recording, FAST, mask=mask).maps, truth)

    masked, alone = errors(truth.mask), errors()
    monkeypatch.setattr(deciding, "EFFECTS", [e for e in deciding.EFFECTS if not isinstance(e, Outline)])
    dark = errors()
    assert alone["median_deg"] < 1.2 * masked["median_deg"]
    assert alone["rmse"] < 2 * masked["rmse"]  # pixels of the rim are dark in part
    assert dark["median_deg"] > 1.6 * alone["median_deg"] and dark["rmse"] > 1.4 * alone["rmse"]

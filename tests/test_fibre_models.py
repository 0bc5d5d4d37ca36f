"""Fibre models by name, with one from outside: registration, scenes, and the key of its kernels."""

import pickle

import pytest
from lambert_fibre import (
    MODEL,
    Lambert,
    LambertFibre,
    document,
    reference,
    registered_lambert,
)
from model_checks import check_reference
from scene_documents import fur_patch

import furcl
from furcl.device.features import Features
from furcl.errors import FibreError, SceneError
from furcl.fibre import model as models
from furcl.fibre.model import Lobe
from furcl.scene.read import with_overrides

COLOURED = LambertFibre((0.9, 0.5, 0.2), 0.6)
WHITE = {"model": "lambert"}


@pytest.fixture(autouse=True)
def registered():
    with registered_lambert():
        yield


def test_it_is_known_while_it_is_registered():
    assert models.names()[-1] == "lambert"
    assert models.find("lambert") is MODEL
    models.unregister("lambert")
    with pytest.raises(FibreError, match=r"'lambert'.*models\.register adds one"):
        models.find("lambert")
    with pytest.raises(SceneError, match="lambert"):
        fur_patch(WHITE)
    models.register(MODEL)


def test_names_of_furcl_are_kept():
    class Taken(Lambert):
        name = "double-cylinder"

    with pytest.raises(FibreError, match="choose another"):
        models.register(Taken())


@pytest.mark.parametrize(
    ("lacks", "lobe", "message"),
    [
        (None, Lobe("diffuse"), r"bcsdf\.clh cannot be read: No such file"),
        ("lobe_terms", Lobe("diffuse"), r"does not define lobe_terms; see kernels/"),
        ("", Lobe("diffuse", h_given_phi=True), r"does not define lobe_azimuthal_estimate;"),
    ],
)
def test_headers_are_checked(tmp_path, lacks, lobe, message):
    path = tmp_path / "bcsdf.clh"
    if lacks is not None:
        text = MODEL.header.read_text()
        path.write_text(text.replace(lacks, "other") if lacks else text)

    class Own(Lambert):
        name = "own"
        lobes = (lobe,)
        header = path

    with pytest.raises(FibreError, match=f"^fibre model 'own': .*{message}"):
        models.register(Own())
    assert "own" not in models.names()


@pytest.mark.parametrize(
    ("table", "message"),
    [
        ({"rim": 2.0}, r"fibre\.rim = 2\.0 - allowed is 0 to 1"),
        ({"kappa": 0.5}, r"unknown key fibre\.kappa with model = 'lambert'"),
    ],
)
def test_scenes_refuse_what_it_has_not(table, message):
    with pytest.raises((SceneError, FibreError), match=message):
        fur_patch({**WHITE, **table}).build_fibre()


def test_a_scene_tells_its_fibre():
    scene = fur_patch(document(COLOURED))
    assert scene.build_fibre() == COLOURED
    assert with_overrides(scene, ["fibre.rim=0.25"]).build_fibre().rim == 0.25
    assert with_overrides(scene, ["fibre={model='double-cylinder', preset='raccoon'}"]).build_fibre(
    ) == furcl.Fibre.preset("raccoon")  # fmt: skip


def test_its_features_are_a_key():
    """Two fibres that need the same text share it; what they need survives pickling."""
    features = Features(fibre=MODEL.features(COLOURED))
    assert pickle.loads(pickle.dumps(features)) == features
    assert Features(fibre=MODEL.features(LambertFibre(rim=0.1))) == features
    assert Features(fibre=MODEL.features(LambertFibre())) != features


def test_its_reference_has_what_the_page_lists():
    check_reference(reference)

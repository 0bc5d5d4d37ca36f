"""Small scenes that several tests render."""

from furcl.scene.read import decode_scene

# Tests of pictures take the variance that a film keeps for the error: samples of a pixel have to be
# independent.
INDEPENDENT = {"sequence": "independent", "roulette": "depth"}

MINIMAL = {
    "fibre": {"preset": "human-black"},
    "environment": {"kind": "constant"},
    "curves": {"generator": "fibre"},
}


def minimal(**tables):
    """The smallest document of a scene, with tables replaced or added."""
    return {**MINIMAL, **tables}


def fur_patch(fibre=None, **render):
    """A patch of fur in a sky, 24 x 16 pixels."""
    return decode_scene(
        {
            "film": {"width": 24, "height": 16},
            "camera": {"azimuth_deg": -60.0, "elevation_deg": 40.0},
            "fibre": fibre or {"preset": "red-fox"},
            "environment": {"kind": "sky", "sun_radius_deg": 5.0},
            "curves": {
                "generator": "fur", "surface": "patch", "patch_size": [1.0, 1.0],
                "n_strands": 300, "length": 0.3, "radius": 0.01,
            },
            "render": {"spp": 8, **INDEPENDENT, **render},
        },
        "fur patch",
    )  # fmt: skip


def even_patch(fibre=None):
    """A patch of fur in even light, quick to compile and to render: without a medulla."""
    return decode_scene(
        {
            "name": "patch",
            "camera": {"origin": [0.0, -0.7, 0.7], "target": [0.0, 0.0, 0.15], "vfov_deg": 25},
            "film": {"width": 24, "height": 24},
            "fibre": fibre or {"preset": "human-black", "kappa": 0.0, "sigma_ca": 0.5},
            "environment": {"kind": "constant"},
            "curves": {
                "generator": "fur", "surface": "patch", "patch_size": [1.0, 1.0],
                "n_strands": 500, "length": 0.3, "radius": 0.01,
            },
            "render": INDEPENDENT,
        }
    )  # fmt: skip


def single_fibre(theta_deg, fibre, **render):
    """A smooth straight fibre that fills the picture, seen at an inclination, in white light.

    The camera is far away: every ray has almost the inclination `theta_deg`.
    """
    import numpy as np

    theta = np.deg2rad(theta_deg)
    distance = 2000.0
    return decode_scene(
        {
            "film": {"width": 8, "height": 8, "filter": "box"},
            "camera": {
                "origin": [float(distance * np.sin(theta)), float(-distance * np.cos(theta)), 0.0],
                "target": [0.0, 0.0, 0.0],
                "vfov_deg": 0.1,
                "up": [0.0, 0.0, 1.0],
                # +-1.7 units at the fibre, whose radius is 2.
            },
            "fibre": fibre,
            "environment": {"kind": "constant", "radiance": 1.0},
            "curves": {"generator": "fibre", "axis": "x", "radius": 2.0, "length": 1000.0},
            "render": {"spp": 512, **INDEPENDENT, **render},
        },
        "single fibre",
    )

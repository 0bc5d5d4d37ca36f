"""The example of docs/own_sampler.md: compare a sampler of one's own with those of furcl.

python bench/compare_own_sampler.py SCENE.toml FOLDER
"""

import sys
from pathlib import Path

import furcl
from furcl.bench import convergence
from furcl.bench.convergence_plan import Plan
from furcl.report.convergence import interval, write_report


def main(scene: str, folder: str, size: str = "96x96", runs: str = "5") -> None:
    """Compare three samplers on a scene and write the page."""
    furcl.fibre.samplers.register(
        "lobe-cdf",
        Path(__file__).parent / "samplers" / "lobe_cdf.clh",
        needs_tables=True,
        scattered_angles="uniform",
    )
    plan = Plan(
        scenes=(furcl.load_scene(scene, size=size),),
        sampling=("uniform-h", "attenuation-cdf", "lobe-cdf"),
        spp=(8, 16, 32, 64),
        runs=int(runs),
    )
    results = convergence.run(plan, folder)
    for comparison in results["scenes"][0]["comparisons"]:
        print(comparison["variant"], "efficiency", interval(comparison["efficiency"]))
    print("wrote", write_report(folder))


if __name__ == "__main__":
    main(*sys.argv[1:])

"""Installs imotor_ros as an ament_python package."""

from pathlib import Path

from setuptools import find_packages, setup

PACKAGE = "imotor_ros"

NODES = [
    "signal_generator",
    "plant",
    "vibrometer",
    "force_sensor",
    "evaluator",
    "recorder",
    "player",
    "template_driver",
    "scpi_bench",
]


def list_params() -> list[tuple[str, list[str]]]:
    """Return every folder under params/ with its files, as data files of the package's share."""
    folders = sorted({path.parent for path in Path("params").rglob("*") if path.is_file()})
    return [
        (
            f"share/{PACKAGE}/{folder}",
            sorted(str(path) for path in folder.iterdir() if path.is_file()),
        )
        for folder in folders
    ]


setup(
    name=PACKAGE,
    version="0.1.0",
    description="A test stand for piezoelectric inertia motors as ROS 2 nodes",
    license="Apache-2.0",
    maintainer="imotor_ros maintainers",
    maintainer_email="maintainers@imotor-ros.invalid",
    packages=find_packages(include=[PACKAGE, f"{PACKAGE}.*"]),
    package_data={
        PACKAGE: [
            "py.typed",
            "nodes/*.xml",
            "cli/campaign_report/*.css",
            "cli/campaign_report/*.js",
        ]
    },
    data_files=[
        ("share/ament_index/resource_index/packages", [f"resource/{PACKAGE}"]),
        (f"share/{PACKAGE}", ["package.xml"]),
        (f"share/{PACKAGE}/launch", ["launch/stand.launch.py"]),
        *list_params(),
    ],
    install_requires=[
        "setuptools",
        "numpy",
        "scipy",
        "numba",
        "rosbags",
        "matplotlib",
        "pyyaml",
        "rich",
        "pyvisa",
        "pyvisa-py",
    ],
    extras_require={"dask": ["distributed"]},
    python_requires=">=3.11",
    zip_safe=True,
    entry_points={
        "console_scripts": [
            *(f"{name} = {PACKAGE}.nodes.{name}:main" for name in NODES),
            f"run_campaign = {PACKAGE}.cli.run:main",
            f"virtual_instruments = {PACKAGE}.nodes.virtual_instruments.server:main",
        ],
    },
)

"""Packaging of snnav_sim for colcon, ament and pip."""

from setuptools import find_packages, setup

PACKAGE = "snnav_sim"

setup(
    name=PACKAGE,
    version="0.1.0",
    description="Sensor-network navigation: a world to test in",
    license="Apache-2.0",
    author="snnav maintainers",
    maintainer="snnav maintainers",
    maintainer_email="snnav-maintainers@example.org",
    python_requires=">=3.11",
    package_dir={"": "."},  # said in so many words, pip links an editable installation by a plain .pth
    packages=find_packages(),
    package_data={PACKAGE: ["py.typed", "scenes/*.yaml", "report/*.html"]},
    data_files=[
        ("share/ament_index/resource_index/packages", [f"resource/{PACKAGE}"]),
        (f"share/{PACKAGE}", ["package.xml"]),
    ],
    install_requires=[
        "setuptools",
        "snnav_core",
        "numpy>=1.26",
        "matplotlib>=3.6",
        "Pillow>=9",
        "PyYAML>=6",
        "rich",
        "trimesh",
    ],
    extras_require={"test": ["pytest", "pytest-timeout", "hypothesis"]},
    zip_safe=False,
)

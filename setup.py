"""The folder ``weights`` is installed as ``plat/weights``; pyproject.toml says everything else."""

from setuptools import find_namespace_packages, setup

weights = ["plat.weights", *(f"plat.weights.{run}" for run in find_namespace_packages("weights"))]
setup(packages=[*find_namespace_packages(include=["plat*"]), *weights], package_dir={"plat.weights": "weights"})

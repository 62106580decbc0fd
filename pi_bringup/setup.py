"""Tells catkin about the Python package; not to be run by hand."""

from catkin_pkg.python_setup import generate_distutils_setup
from setuptools import setup

setup(**generate_distutils_setup(packages=["pi_bringup", "pi_bringup.doctor", "pi_bringup.fleet"], package_dir={"": "src"}))

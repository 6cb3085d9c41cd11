"""Build of the bridge by colcon (ament_python)."""

from setuptools import setup

setup(
    name="armwright_bridge",
    version="0.4.0",
    packages=["armwright_bridge"],
    data_files=[
        ("share/ament_index/resource_index/packages", ["resource/armwright_bridge"]),
        ("share/armwright_bridge", ["package.xml"]),
    ],
    install_requires=["setuptools"],
    entry_points={"console_scripts": ["bridge = armwright_bridge.bridge:main"]},
)

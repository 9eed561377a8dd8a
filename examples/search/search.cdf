# yaml-language-server: $schema=../../schemas/cdf.schema.json
# One image for robots and base; the experiment says which script each one runs.
cdf: 1
name: search
description: Cyclone DDS for Python, with robots that search an area and a base.
license: Apache-2.0
base: debian:bookworm
platforms: [linux/amd64] # PyPI has no Linux wheel of cyclonedds for ARM
packages:
  apt: [python3, python3-pip]
  pip: [cyclonedds==11.0.1]
files:
  - { src: area.py, dest: /opt/search/area.py }
  - { src: fleet.py, dest: /opt/search/fleet.py }
  - { src: robot.py, dest: /opt/search/robot.py }
  - { src: base.py, dest: /opt/search/base.py }
environment:
  PYTHONUNBUFFERED: "1"

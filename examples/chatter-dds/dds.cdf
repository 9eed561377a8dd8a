# yaml-language-server: $schema=../../schemas/cdf.schema.json
# One image for all three services; the experiment says which script each one runs.
cdf: 1
name: dds
description: Cyclone DDS for Python, with a publisher and a subscriber.
license: Apache-2.0
base: debian:bookworm
platforms: [linux/amd64] # PyPI has no Linux wheel of cyclonedds for ARM
packages:
  apt: [python3, python3-pip]
  pip: [cyclonedds==11.0.1]
files:
  - { src: greeting.py, dest: /opt/chatter/greeting.py }
  - { src: publisher.py, dest: /opt/chatter/publisher.py }
  - { src: subscriber.py, dest: /opt/chatter/subscriber.py }
environment:
  PYTHONUNBUFFERED: "1"

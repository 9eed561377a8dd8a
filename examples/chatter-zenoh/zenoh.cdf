# yaml-language-server: $schema=../../schemas/cdf.schema.json
# One image for all three services; the experiment says which script each one runs.
cdf: 1
name: zenoh
description: Zenoh for Python, with a router, a publisher and a subscriber.
license: Apache-2.0
base: debian:bookworm
platforms: [linux/amd64, linux/arm64]
packages:
  apt: [python3, python3-pip]
  pip: [eclipse-zenoh==1.10.2]
files:
  - { src: stopping.py, dest: /opt/chatter/stopping.py }
  - { src: router.py, dest: /opt/chatter/router.py }
  - { src: publisher.py, dest: /opt/chatter/publisher.py }
  - { src: subscriber.py, dest: /opt/chatter/subscriber.py }
environment:
  PYTHONUNBUFFERED: "1"

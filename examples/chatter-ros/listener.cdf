# yaml-language-server: $schema=../../schemas/cdf.schema.json
cdf: 1
name: listener
description: Prints everything that is said on /chatter.
extends: ros.cdf
files:
  - { src: listener.py, dest: /opt/chatter/listener.py }
command: [python3, /opt/chatter/listener.py]

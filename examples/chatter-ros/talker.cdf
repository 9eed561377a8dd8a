# yaml-language-server: $schema=../../schemas/cdf.schema.json
cdf: 1
name: talker
description: Publishes a greeting on /chatter every half second.
extends: ros.cdf
files:
  - { src: talker.py, dest: /opt/chatter/talker.py }
command: [python3, /opt/chatter/talker.py]

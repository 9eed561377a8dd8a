# yaml-language-server: $schema=../../schemas/cdf.schema.json
cdf: 1
name: rosmaster
description: The ROS master. Healthy as soon as it answers.
extends: ros.cdf
files:
  - { src: master_answers.py, dest: /opt/chatter/master_answers.py }
command: [rosmaster, --core, -p, "11311"]
stop_signal: SIGINT # what it ends cleanly on
healthcheck:
  test: [CMD, python3, /opt/chatter/master_answers.py]
  interval: 1s
  timeout: 5s
  retries: 30

# yaml-language-server: $schema=../../schemas/cdf.schema.json
# What the three services share. Debian ships ROS 1; these packages are enough for a master and for nodes in Python.
cdf: 1
name: ros
description: ROS 1 from Debian, for a master and for nodes in Python.
license: Apache-2.0
base: debian:bookworm
platforms: [linux/amd64, linux/arm64]
packages:
  apt: [python3-rosmaster, python3-rospy, python3-std-msgs, python3-netifaces]
environment:
  PYTHONUNBUFFERED: "1"

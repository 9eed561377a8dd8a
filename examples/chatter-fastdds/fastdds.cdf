# yaml-language-server: $schema=../../schemas/cdf.schema.json
# One image for all three services: Debian's Fast DDS with its Discovery Server, and a small program.
cdf: 1
name: fastdds
description: Fast DDS from Debian, with a publisher and a subscriber.
license: Apache-2.0
base: debian:bookworm
platforms: [linux/amd64, linux/arm64]
packages:
  apt: [fastdds-tools, g++, libfastrtps-dev]
files:
  - { src: chatter.cpp, dest: /opt/chatter/chatter.cpp }
run:
  - g++ -std=c++17 -O1 -o /usr/local/bin/chatter /opt/chatter/chatter.cpp -lfastrtps -lfastcdr

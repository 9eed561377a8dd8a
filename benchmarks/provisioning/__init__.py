"""The main job, done by srprov and by others on the same lab: time, CPU and bytes. See README.md beside this file."""

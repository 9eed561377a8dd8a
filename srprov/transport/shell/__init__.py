"""What is said to a robot's shell: batches of commands (`shell.py`, `frames.py`) and the channel of a lock."""

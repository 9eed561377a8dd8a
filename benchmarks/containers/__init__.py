"""What a container costs beside a native process: processor, memory, and a stand-in for SLAMBench."""

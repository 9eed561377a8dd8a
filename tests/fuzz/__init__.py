"""Mutated files of every kind, under the kernel's eye: see fuzzer.py."""

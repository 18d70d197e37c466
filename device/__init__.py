"""What the box does: configuration, daemon, surveys, verdicts, store, command line.

Time, threads, storage and policy meet here.
"""

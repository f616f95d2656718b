"""What every other folder uses: errors, options, temporary files, a stopwatch, memory."""

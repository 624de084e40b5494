"""Plans in the formats of other programs: MCAP for Foxglove, CSV as the authors write it."""

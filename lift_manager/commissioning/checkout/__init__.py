"""The acceptance test of a lift: what is tested, how, and the record that people sign."""

"""How images get to robots: srprov beside other ways."""

"""One small file per verb; the only room that prints, asks or exits."""

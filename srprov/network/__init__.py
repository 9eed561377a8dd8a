"""The overlay: `layout.layout` computes it, `hosts` and `record` say it in files. Pure."""

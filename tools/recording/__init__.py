"""A terminal that was recorded, as a picture that moves: `python -m tools.recording`.

    __main__.py    the steps of `make demo`, typed on a terminal of their own, in a lab of their own
    terminal.py    a program on a terminal -> what stood on its screen, and when
    svg.py         such screens -> one SVG file, without a script and without anything from elsewhere

Nobody edits the picture: it shows what was printed. Waiting is shortened, as the picture itself says.
"""

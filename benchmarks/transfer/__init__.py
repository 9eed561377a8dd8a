"""What brings results home: srprov beside other ways, and over a link that is cut."""

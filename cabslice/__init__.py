"""cabslice: from an STL to the motor angles of a cable printer."""

__version__ = "0.1.0"

"""Numbers to some digits, in sentences and in files."""


def plain(value: float, digits: int = 3) -> str:
    """Return a number to some significant digits, without an exponent below a million.

    Example:
        >>> plain(1123.4), plain(0.05), f"{1123.4:.3g}"
        ('1120', '0.05', '1.12e+03')
    """
    return f"{float(f'{value:.{digits}g}'):g}"


def short(value: float, digits: int = 8) -> float:
    """Return a number for a file: to some significant digits."""
    return float(f"{float(value):.{digits}g}")

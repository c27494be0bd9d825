"""What results print, without line breaks and columns."""


def said(result):
    """The printed text with single spaces."""
    return " ".join(str(result).split())

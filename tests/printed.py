"""What results print: the whole text, and single rows of their statements."""

from bdamper.util.statement import Row


def said(result):
    """The printed text with single spaces."""
    return " ".join(str(result).split())


def row(result, name):
    """The row of a quantity; an empty one if the statement has none."""
    rows = [row for row in result._statement().rows if row.name == name]
    assert len(rows) <= 1
    return rows[0] if rows else Row("", "")


def value(result, name):
    """The printed value of a quantity, or ""."""
    return row(result, name).value


def check(result, name):
    """The row of a check of the statement."""
    (found,) = [row for row in result._statement().checks if row.name == name]
    return found

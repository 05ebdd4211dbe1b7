"""What a piece of text is, in one word; the style sheet says what it looks like. Plain data, no terminal needed."""

Run = tuple[str, str]  # text and style
Row = list[Run]

# The three of traces, what is around them, and what is said of anything.
TRACES = ("first", "second", "faint")
HEADING, UNIT, LABEL, RULE, GRID = "heading", "unit", "label", "rule", "grid"
TEXT, STRONG, GOOD, WARNING, BAD = "text", "strong", "good", "warning", "bad"
BADGES = ("badge-calm", "badge-good", "badge-warning", "badge-bad")
STYLES = (*TRACES, HEADING, UNIT, LABEL, RULE, GRID, TEXT, STRONG, GOOD, WARNING, BAD, *BADGES)


def length(row: Row) -> int:
    """In characters; all of ours are one column wide."""
    return sum(len(text) for text, _ in row)


def fitted(row: Row, width: int) -> Row:
    """Cut or filled up to ``width`` characters."""
    done: Row = []
    for text, style in row:
        if width > 0:
            done.append((text[:width], style))
            width -= len(done[-1][0])
    return [*done, (" " * width, TEXT)] if width > 0 else done


def apart(left: Row, right: Row, width: int) -> Row:
    """One at either end; where there is no room for both, the left one gives way."""
    room = max(width - length(right), 0)
    gap = min(1, room)
    return [*fitted(left, room - gap), (" " * gap, TEXT), *fitted(right, min(width, length(right)))]


def heading(title: str, unit: str, latest: str, width: int, legend: str = "") -> Row:
    """One row: title and unit, what the second style is, a rule, and what is to be said at its right end."""
    left: Row = [(title, HEADING)] + ([(f" {unit}", UNIT)] if unit else [])
    right: Row = [(f" {latest}", "first")] if latest else []
    explained: Row = [*left, (f"  {legend}", "second")] if legend else left
    for begin, end in ((explained, right), (left, right), (left, [])):
        rule = width - length(begin) - length(end) - 1
        if rule >= 1:
            return [*begin, (" " + "─" * rule, RULE), *end]
    return fitted(left, width)

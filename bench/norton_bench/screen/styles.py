"""Names of styles for pieces of text; the style sheet defines them. Plain data, no terminal needed."""

Run = tuple[str, str]  # text and style
Row = list[Run]

# Three for traces, those around traces, and those for text.
TRACES = ("first", "second", "faint")
HEADING, UNIT, LABEL, RULE, GRID = "heading", "unit", "label", "rule", "grid"
TEXT, STRONG, GOOD, WARNING, BAD = "text", "strong", "good", "warning", "bad"
BADGES = ("badge-calm", "badge-good", "badge-warning", "badge-bad")
STYLES = (*TRACES, HEADING, UNIT, LABEL, RULE, GRID, TEXT, STRONG, GOOD, WARNING, BAD, *BADGES)


# Narrower than this, rows are folded and panels stand one above the other; made for a phone's 45 columns.
LEAST_COLUMNS = 70
PHONE = [(0, "-phone"), (LEAST_COLUMNS, "-narrow")]


def length(row: Row) -> int:
    """Length in characters; all that are used are one column wide."""
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
    """One at each end; where there is no room for both, the left one is cut."""
    room = max(width - length(right), 0)
    gap = min(1, room)
    return [*fitted(left, room - gap), (" " * gap, TEXT), *fitted(right, min(width, length(right)))]


def heading(title: str, unit: str, latest: str, width: int, legend: str = "") -> Row:
    """One row: title and unit, the legend of the second style, a rule, and ``latest`` at the right."""
    left: Row = [(title, HEADING)] + ([(f" {unit}", UNIT)] if unit else [])
    right: Row = [(f" {latest}", "first")] if latest else []
    explained: Row = [*left, (f"  {legend}", "second")] if legend else left
    for begin, end in ((explained, right), (left, right), (left, [])):
        rule = width - length(begin) - length(end) - 1
        if rule >= 1:
            return [*begin, (" " + "─" * rule, RULE), *end]
    return fitted(left, width)

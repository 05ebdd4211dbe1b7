"""Logs of several joints: one of them is chosen by its name, which stands for ``{joint}`` in the names of a map."""

import re
from collections.abc import Iterable, Iterator
from dataclasses import replace

from norton_bench.errors import UsageError, nearest
from norton_bench.logs.column_map import ColumnMap, Given
from norton_bench.logs.files import Content, split_unit

JOINT = "{joint}"
# More joints than this are not listed.
LISTED = 12


def with_joint(column_map: ColumnMap, joint: str | None) -> ColumnMap:
    """The map for the joint that the command line names. Raises UsageError for a map that is of one joint alone."""
    if joint is None:
        return column_map
    if not any(JOINT in name for name in _names(column_map)):
        raise UsageError(
            f'--joint: no name in {column_map.place} has {JOINT} in it; write it there, such as "position[{JOINT}]"'
        )
    return replace(column_map, log=column_map.log.model_copy(update={"joint": joint}))


def of_its_joint(column_map: ColumnMap, content: Content) -> tuple[ColumnMap, tuple[str, ...]]:
    """The map with the names of its joint's columns, and what is to be said: a log of one joint needs no choice.

    Raises UsageError, with the joints that there are, where none or an unknown one is named.
    """
    names = [name for name in _names(column_map, needed=True) if JOINT in name]
    if not names:
        return column_map, ()
    there = _there(content)
    known = [found for name in names if (found := _joints(name, there))]
    joints = [joint for joint in known[0] if all(joint in each for each in known)] if known else []
    joint = column_map.log.joint
    if joint is None and len(joints) == 1:
        return _for(column_map, joints[0]), (f'{content.place}: the joint is "{joints[0]}", the only one.',)
    if joint is None:
        raise UsageError(asking(content.place, joints, "--joint NAME"))
    if joints and joint not in joints:
        raise UsageError(f'{content.place}: holds no joint "{joint}"; {nearest(joint, joints)}')
    return _for(column_map, joint), ()


def asking(place: str, joints: Iterable[str], mend: str) -> str:
    """The sentence that asks for a joint."""
    listed = list(joints)
    if not listed:
        return f"{place}: no column is of a joint as the map names them; check its names, and name a joint: {mend}"
    more = f" and {len(listed) - LISTED} more" if len(listed) > LISTED else ""
    return f"{place}: holds several joints ({', '.join(listed[:LISTED])}{more}); choose one: {mend}"


def _names(column_map: ColumnMap, *, needed: bool = False) -> Iterator[str]:
    """Those of all columns and known numbers; or only of columns that may not be missing."""
    for section in column_map.mapped().values():
        if not (needed and section.optional):
            yield section.name
    if not needed:
        for given in column_map.givens().values():
            yield from given.names


def _there(content: Content) -> list[str]:
    """The names in the log, with and without the units behind them."""
    bare = [] if content.times_s else [split_unit(name)[0] for name in content.arrays]
    return [*content.arrays, *bare]


def _joints(name: str, there: Iterable[str]) -> list[str]:
    """What can stand for the joint in a name of the map, in the order of the log."""
    first, *others = map(re.escape, name.split(JOINT))
    pattern = re.compile(first + "(.+)" + r"\1".join(others), re.DOTALL)
    return list(dict.fromkeys(found[1] for each in there if (found := pattern.fullmatch(each))))


def _for(column_map: ColumnMap, joint: str) -> ColumnMap:
    columns = {
        what: section.model_copy(update={"name": section.name.replace(JOINT, joint)})
        for what, section in column_map.mapped().items()
    }
    sections = {}
    for name in {section for section, _ in column_map.givens()}:
        givens = {key: _given(each, joint) for (section, key), each in column_map.givens().items() if section == name}
        sections[name] = getattr(column_map, name).model_copy(update=givens)
    return replace(column_map, columns=column_map.columns.model_copy(update=columns), **sections)


def _given(given: Given, joint: str) -> Given:
    key = None if given.key is None else given.key.replace(JOINT, joint)
    return given.model_copy(update={"key": key, "keys": tuple(each.replace(JOINT, joint) for each in given.keys)})

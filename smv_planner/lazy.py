"""Dataclasses that are finished when they are used.

`dataclasses.dataclass` writes and compiles six methods for every class, at import. Of a hundred classes that was a quarter
of what `smv-plan` took, and most of the methods are never called. Here a method is written when it is called first. In all
else these are dataclasses: `dataclasses.fields`, `asdict` and `replace` know them. They are as much as this project
uses: no inheritance between dataclasses, no order, none of the written methods by hand.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, Any, NoReturn

_MISSING: Any = object()
_WRITTEN = frozenset(["__init__", "__repr__", "__eq__", "__hash__"])


class _Field:
    """What a class says of a field beyond its type."""

    __slots__ = ("compare", "default", "default_factory", "name")
    name: str

    def __init__(self, *, default: Any = _MISSING, default_factory: Any = _MISSING, compare: bool = True) -> None:
        self.default = default
        self.default_factory = default_factory
        self.compare = compare


def _dataclass(
    cls: Any = None, /, *, frozen: bool = False, eq: bool = True, slots: bool = False, weakref_slot: bool = False
) -> Any:
    if cls is None:
        return lambda cls: _dataclass(cls, frozen=frozen, eq=eq, slots=slots, weakref_slot=weakref_slot)
    assert not _WRITTEN & vars(cls).keys(), f"{cls} has methods of its own in place of those of a dataclass"
    assert not any(map(_is_dataclass, cls.__bases__)), f"{cls} inherits fields, which would be lost"
    fields = {name: _described(name, vars(cls).get(name, _MISSING)) for name in cls.__annotations__}
    made: Any = _with_slots(cls, tuple(fields), weakref_slot) if slots else _with_defaults(cls, fields)
    made.__match_args__ = tuple(fields)  # type: ignore[misc]
    made.__fields_of_dataclass__ = fields
    made.__dataclass_fields__ = _DESCRIBED
    _when_called(made, "__init__", lambda: _init(made, fields, frozen, slots))
    _when_called(made, "__repr__", lambda: _repr(fields))
    _when_called(made, "__replace__", lambda: _replacing(made, fields))
    if eq:
        _when_called(made, "__eq__", lambda: _eq(fields))
    if eq and frozen:
        _when_called(made, "__hash__", lambda: _hash(fields))
    elif eq:
        made.__hash__ = None
    if frozen:
        made.__setattr__, made.__delattr__ = _no_setting, _no_deleting
    if frozen and slots:
        made.__getstate__, made.__setstate__ = _getstate, _setstate
    return made


def _described(name: str, said: Any) -> _Field:
    field: _Field = said if isinstance(said, _Field) else _Field(default=said)
    field.name = name
    return field


def _with_slots(cls: type, slots: tuple[str, ...], weakref_slot: bool) -> Any:
    """The class made anew, for slots can be given to it only when it is made."""
    left_out = {*slots, "__dict__", "__weakref__"}
    content = {name: value for name, value in vars(cls).items() if name not in left_out}
    content["__slots__"] = (*slots, "__weakref__") if weakref_slot else slots
    made = type(cls)(cls.__name__, cls.__bases__, content)
    made.__qualname__ = cls.__qualname__
    return made


def _with_defaults(cls: type, fields: Mapping[str, _Field]) -> Any:
    for name, field in fields.items():
        if field.default is not _MISSING:
            setattr(cls, name, field.default)
        elif name in vars(cls):
            delattr(cls, name)
    return cls


def _when_called(cls: type, name: str, write: Callable[[], Any]) -> None:
    """A stand-in for a method, which is written when it is called."""

    def stand_in(self: Any, *arguments: Any, **named: Any) -> Any:
        method = write()
        method.__qualname__ = f"{cls.__qualname__}.{name}"
        setattr(cls, name, method)
        return method(self, *arguments, **named)

    setattr(cls, name, stand_in)


def _init(cls: type, fields: Mapping[str, _Field], frozen: bool, slots: bool) -> Any:
    known: dict[str, Any] = {"_factory": _MISSING, "_set": object.__setattr__}
    parameters, body = ["self"], []
    for name, field in fields.items():
        value, default = name, ""
        if field.default_factory is not _MISSING:
            known[f"_new_{name}"] = field.default_factory
            value, default = f"_new_{name}() if {name} is _factory else {name}", "=_factory"
        elif field.default is not _MISSING:
            known[f"_default_{name}"] = field.default
            default = f"=_default_{name}"
        parameters.append(name + default)
        if not frozen:
            body.append(f"self.{name} = {value}")
        elif not slots:
            body.append(f"_set(self, {name!r}, {value})")
        else:
            known[f"_set_{name}"] = vars(cls)[name].__set__
            body.append(f"_set_{name}(self, {value})")
    if hasattr(cls, "__post_init__"):
        body.append("self.__post_init__()")
    return _written("__init__", parameters, body or ["pass"], known)


def _repr(fields: Mapping[str, _Field]) -> Any:
    shown = ", ".join(f"{name}={{self.{name}!r}}" for name in fields)
    return _written("__repr__", ["self"], [f"return f'{{self.__class__.__qualname__}}({shown})'"], {})


def _eq(fields: Mapping[str, _Field]) -> Any:
    same = f"{_compared('self', fields)} == {_compared('other', fields)}"
    return _written("__eq__", ["self", "other"], [f"return {same} if other.__class__ is self.__class__ else NotImplemented"], {})


def _hash(fields: Mapping[str, _Field]) -> Any:
    return _written("__hash__", ["self"], [f"return hash({_compared('self', fields)})"], {})


def _replacing(cls: type, fields: Mapping[str, _Field]) -> Any:
    parameters = ["self", "*", *(f"{name}=_same" for name in fields)] if fields else ["self"]
    values = ", ".join(f"self.{name} if {name} is _same else {name}" for name in fields)
    return _written("__replace__", parameters, [f"return _class({values})"], {"_same": _MISSING, "_class": cls})


def _compared(value: str, fields: Mapping[str, _Field]) -> str:
    return "(" + "".join(f"{value}.{name}, " for name, field in fields.items() if field.compare) + ")"


def _written(name: str, parameters: list[str], body: list[str], known: dict[str, Any]) -> Any:
    text = f"def {name}({', '.join(parameters)}):\n " + "\n ".join(body)
    exec(compile(text, "<dataclass>", "exec"), known)
    return known[name]


def _no_setting(self: object, name: str, value: object) -> NoReturn:
    from dataclasses import FrozenInstanceError

    raise FrozenInstanceError(f"cannot assign to field {name!r}")


def _no_deleting(self: object, name: str) -> NoReturn:
    from dataclasses import FrozenInstanceError

    raise FrozenInstanceError(f"cannot delete field {name!r}")


def _getstate(self: Any) -> list[Any]:
    return [getattr(self, name) for name in self.__match_args__]


def _setstate(self: Any, state: list[Any]) -> None:
    for name, value in zip(self.__match_args__, state, strict=True):
        object.__setattr__(self, name, value)


class _Described:
    """The fields of a class as the library describes them, once somebody asks it."""

    def __get__(self, instance: object, owner: Any) -> Any:
        import dataclasses

        described = [(each.name, owner.__annotations__[each.name], _of_library(each)) for each in _fields(owner)]
        twin: Any = dataclasses.make_dataclass(owner.__name__, described)
        owner.__dataclass_fields__ = twin.__dataclass_fields__
        return twin.__dataclass_fields__


_DESCRIBED = _Described()


def _of_library(field: _Field) -> Any:
    import dataclasses

    said = {"default": field.default, "default_factory": field.default_factory, "compare": field.compare}
    return dataclasses.field(**{name: value for name, value in said.items() if value is not _MISSING})


def _fields(of: Any) -> tuple[_Field, ...]:
    return tuple(of.__fields_of_dataclass__.values())


def _is_dataclass(value: Any) -> bool:
    return hasattr(value, "__fields_of_dataclass__")


def _replace(value: Any, /, **changes: Any) -> Any:
    return value.__replace__(**changes)


if TYPE_CHECKING:
    from dataclasses import MISSING as MISSING
    from dataclasses import dataclass as dataclass
    from dataclasses import field as field
    from dataclasses import fields as fields
    from dataclasses import is_dataclass as is_dataclass
    from dataclasses import replace as replace
else:
    MISSING, dataclass, field, fields, is_dataclass, replace = _MISSING, _dataclass, _Field, _fields, _is_dataclass, _replace

"""Options of a command line from a pydantic model: name, type, default, help, bounds, environment."""

import inspect
from collections.abc import Callable, Collection
from copy import copy
from functools import wraps
from typing import Annotated, Any, TypeVar

import typer
from annotated_types import Ge, Le
from pydantic import BaseModel, ValidationError, create_model
from pydantic.fields import FieldInfo
from typer.models import OptionInfo

Result = TypeVar("Result")


def option(model: type[BaseModel], field: str, *, environment: bool = False, **changes: Any) -> OptionInfo:
    """The option that a field stands for.

    Args:
        model: that has the field. Its description is the help text, its bounds are those of the option, and
            what else typer should know stands as a ``typer.Option(…)`` in its annotation.
        field: its name.
        environment: whether the option may come from the environment, too.
        changes: arguments of ``typer.Option`` that differ from the field's.
    """
    known = model.model_fields[field]
    info = copy(next((each for each in known.metadata if isinstance(each, OptionInfo)), typer.Option()))
    info.help = known.description
    info.envvar = f"UNSPOKEN_{field.upper()}" if environment else None
    info.min = next((each.ge for each in known.metadata if isinstance(each, Ge)), None)
    info.max = next((each.le for each in known.metadata if isinstance(each, Le)), None)
    for name, value in changes.items():
        setattr(info, name, value)
    return info


def with_options(
    *, environment: bool = False, without: Collection[str] = (), **changes: dict[str, Any]
) -> Callable[[Callable[..., Result]], Callable[..., Result]]:
    """A decorator of commands: of the parameter that is a model, each field becomes an option.

    Args:
        environment: whether these options may come from the environment, too.
        without: fields that are no options of this command and keep their defaults.
        changes: by field, arguments of ``typer.Option`` that differ from the field's.
    """

    def decorated(command: Callable[..., Result]) -> Callable[..., Result]:
        parameters = inspect.signature(command, eval_str=True).parameters
        [(slot, model)] = [(name, each.annotation) for name, each in parameters.items() if _is_model(each)]
        options = [
            inspect.Parameter(
                name,
                inspect.Parameter.KEYWORD_ONLY,
                default=inspect.Parameter.empty if field.is_required() else field.default,
                annotation=Annotated[
                    field.annotation, option(model, name, environment=environment, **changes.get(name, {}))
                ],
            )
            for name, field in fields_of(model).items()
            if name not in without
        ]

        @wraps(command)
        def called(**values: Any) -> Result:
            chosen = {each.name: values.pop(each.name) for each in options}
            try:
                return command(**{slot: model(**chosen)}, **values)
            except ValidationError as error:
                [first, *_] = error.errors()
                flag = f"--{str(first['loc'][0]).replace('_', '-')}"
                told = first["msg"].removeprefix("Value error, ")
                raise typer.BadParameter(told, param_hint=flag) from None

        expanded: list[inspect.Parameter] = []
        for name, each in parameters.items():
            expanded += options if name == slot else [each.replace(kind=inspect.Parameter.KEYWORD_ONLY)]
        called.__signature__ = inspect.Signature(expanded)  # type: ignore[attr-defined]
        called.__annotations__ = {}
        return called

    return decorated


def fields_of(model: type[BaseModel]) -> dict[str, FieldInfo]:
    """The fields by name, those first that somebody has to give."""
    return dict(sorted(model.model_fields.items(), key=lambda each: not each[1].is_required()))


def _is_model(parameter: inspect.Parameter) -> bool:
    return isinstance(parameter.annotation, type) and issubclass(parameter.annotation, BaseModel)


def optional(model: type[BaseModel]) -> type[BaseModel]:
    """A model of the same fields, none of which has to be there: what a file may say of the options."""
    fields: dict[str, Any] = {
        name: (Annotated[(field.annotation, field.description, *field.metadata)] | None, None)
        for name, field in fields_of(model).items()
    }
    return create_model(model.__name__, __config__=model.model_config, **fields)

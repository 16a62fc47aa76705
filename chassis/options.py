"""Options of a command line from a pydantic model: name, type, default, help, bounds, environment."""

import inspect
from collections.abc import Callable, Collection
from copy import copy
from functools import wraps
from typing import Annotated, Any, TypeVar

import typer
from annotated_types import Ge, Le
from pydantic import BaseModel, ValidationError, create_model
from typer.models import OptionInfo

Result = TypeVar("Result")


def variable(field: str) -> str:
    """The environment variable of an option: ``UNSPOKEN_BUDGET_MS`` of ``budget_ms``."""
    return f"UNSPOKEN_{field.upper()}"


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
    info.envvar = variable(field) if environment else None
    info.min = next((each.ge for each in known.metadata if isinstance(each, Ge)), None)
    info.max = next((each.le for each in known.metadata if isinstance(each, Le)), None)
    for name, value in changes.items():
        setattr(info, name, value)
    return info


def with_options(
    *, environment: bool = False, without: Collection[str] = (), **changes: dict[str, Any]
) -> Callable[[Callable[..., Result]], Callable[..., Result]]:
    """A decorator of commands: of a parameter that is a model, each field becomes an option.

    Args:
        environment: whether these options may come from the environment, too.
        without: fields that are no options of this command and keep their defaults.
        changes: by field, arguments of ``typer.Option`` that differ from the field's.
    """

    def decorated(command: Callable[..., Result]) -> Callable[..., Result]:
        parameters = inspect.signature(command, eval_str=True).parameters
        [(slot, model)] = [
            (name, each.annotation) for name, each in parameters.items() if _is_model(each.annotation)
        ]
        fields = [name for name in names(model) if name not in without]

        @wraps(command)
        def called(**values: Any) -> Result:
            chosen = {name: values.pop(name) for name in fields}
            try:
                return command(**{slot: model(**chosen)}, **values)
            except ValidationError as error:
                [first, *_] = error.errors()
                raise typer.BadParameter(first["msg"], param_hint=_flag(str(first["loc"][0]))) from None

        expanded: list[inspect.Parameter] = []
        for name, each in parameters.items():
            if name != slot:
                expanded.append(each)
                continue
            for field in fields:
                info = option(model, field, environment=environment, **changes.get(field, {}))
                expanded.append(_parameter(model, field, info))
        keywords = [each.replace(kind=inspect.Parameter.KEYWORD_ONLY) for each in expanded]
        called.__signature__ = inspect.Signature(keywords)  # type: ignore[attr-defined]
        called.__annotations__ = {}
        return called

    return decorated


def names(model: type[BaseModel]) -> list[str]:
    """The fields, those first that somebody has to give."""
    return sorted(model.model_fields, key=lambda name: not model.model_fields[name].is_required())


def _is_model(annotation: object) -> bool:
    return isinstance(annotation, type) and issubclass(annotation, BaseModel)


def _flag(field: str) -> str:
    return f"--{field.replace('_', '-')}"


def _parameter(model: type[BaseModel], field: str, info: OptionInfo) -> inspect.Parameter:
    known = model.model_fields[field]
    return inspect.Parameter(
        field,
        inspect.Parameter.KEYWORD_ONLY,
        default=inspect.Parameter.empty if known.is_required() else known.default,
        annotation=Annotated[known.annotation, info],
    )


def optional(model: type[BaseModel]) -> type[BaseModel]:
    """A model of the same fields, none of which has to be there: what a file may say of the options."""
    fields: dict[str, Any] = {}
    for name in names(model):
        known = model.model_fields[name]
        fields[name] = (Annotated[(known.annotation, known.description, *known.metadata)] | None, None)
    return create_model(model.__name__, __config__=model.model_config, **fields)

"""An executor: every item once, whatever the order; a failure arrives where the results are read."""

from __future__ import annotations

from geoprior.authoring.conformance.check import Check, refuse, require
from geoprior.errors import ConfigError
from geoprior.hooks.types import ExecutorSpec

ITEMS = tuple(range(7))
_FAULT = ConfigError("the function was given 3", "this is what must arrive")


def square(item: int) -> int:
    """What the checks run; importable, as every function that an executor is given."""
    return item * item


def fail_at_three(item: int) -> int:
    """The same, with a fault in it."""
    if item == 3:
        raise _FAULT
    return square(item)


def every_item_is_run_once(spec: ExecutorSpec) -> None:
    """Positions and results of all items, in any order."""
    results = list(spec.factory(spec.config()).run(square, ITEMS))
    require(
        sorted(results) == [(position, square(item)) for position, item in enumerate(ITEMS)],
        f"executor {spec.name!r}: gave {sorted(results)} for the squares of {list(ITEMS)}",
        "yield (position in items, result) once for each item, in the order of completion",
    )


def nothing_to_do_is_done(spec: ExecutorSpec) -> None:
    """No items, no results, and no error."""
    results = list(spec.factory(spec.config()).run(square, ()))
    require(results == [], f"executor {spec.name!r}: gave {results} where there was nothing to do")


def failures_arrive(spec: ExecutorSpec) -> None:
    """An exception of the function is raised to whoever reads the results, message and hint intact."""
    try:
        list(spec.factory(spec.config()).run(fail_at_three, ITEMS))
    except ConfigError as error:
        require(
            (error.message, error.hint) == (_FAULT.message, _FAULT.hint),
            f"executor {spec.name!r}: a failure arrived as {error!r}",
        )
        return
    except Exception as error:  # noqa: BLE001 - a stranger's executor may raise anything
        refuse(
            f"executor {spec.name!r}: a ConfigError of the function arrived as {type(error).__name__}",
            "raise the function's own exception",
        )
    refuse(f"executor {spec.name!r}: a failure of the function was swallowed", "raise it from `run`")


def it_can_be_used_again(spec: ExecutorSpec) -> None:
    """Results may be left unread, and the same executor runs the next items."""
    executor = spec.factory(spec.config())
    results = executor.run(square, ITEMS)
    next(iter(results))
    close = getattr(results, "close", None)
    if close is not None:
        close()
    require(
        sorted(executor.run(square, ITEMS[:2])) == [(0, 0), (1, 1)],
        f"executor {spec.name!r}: cannot be used again after results were left unread",
    )


CHECKS = (
    Check("it runs every item once", every_item_is_run_once),
    Check("it does nothing where nothing is to do", nothing_to_do_is_done),
    Check("a failure of the function arrives", failures_arrive),
    Check("it can be used again", it_can_be_used_again),
)

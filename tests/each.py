"""Run all cases of one question in one test, and report all failures."""

import functools
import inspect
import warnings

import pytest

PARAM = type(pytest.param())


def name_of(case, values, ids, index):
    if callable(ids):
        return "-".join(str(ids(value)) for value in values)
    if ids is not None:
        return str(ids[index])
    return (isinstance(case, PARAM) and case.id) or "-".join(str(value) for value in values)


def each(names, cases, ids=None):
    """Return a decorator that runs a test on each case, with the arguments of ``pytest.mark.parametrize``.

    The cases run in one test. It fails with all failures, each with the name of its case. It is skipped if all cases are,
    and warns if some are. A temporary folder is new for each case, and changes by `monkeypatch` end with it.
    """
    names = [name.strip() for name in names.split(",")] if isinstance(names, str) else names
    cases, ids = list(cases), ids if ids is None or callable(ids) else list(ids)
    assert cases and not any(case.marks for case in cases if isinstance(case, PARAM)), (
        "cases with marks need parametrize"
    )

    def decorate(test):
        signature = inspect.signature(test)

        @functools.wraps(test)
        def run(*args, **fixtures):
            failures, skipped, folder = [], [], fixtures.get("tmp_path")
            for index, case in enumerate(cases):
                values = (
                    case.values if isinstance(case, PARAM) else case if len(names) > 1 else (case,)
                )
                if "tmp_path" in fixtures:
                    fixtures["tmp_path"] = folder / str(index)
                    fixtures["tmp_path"].mkdir()
                try:
                    test(*args, **fixtures, **dict(zip(names, values, strict=True)))
                except pytest.skip.Exception as error:
                    skipped.append(error)
                except (Exception, BaseExceptionGroup, pytest.fail.Exception) as error:
                    error.add_note(f"case {index}: {name_of(case, values, ids, index)}")
                    failures.append(error)
                finally:
                    if "monkeypatch" in fixtures:
                        fixtures["monkeypatch"].undo()
            if failures:
                raise BaseExceptionGroup(f"{len(failures)} of {len(cases)} cases", failures)
            if len(skipped) == len(cases):
                raise skipped[0]
            if skipped:
                warnings.warn(
                    f"{len(skipped)} of {len(cases)} cases skipped: {skipped[0]}", stacklevel=1
                )

        kept = [parameter for name, parameter in signature.parameters.items() if name not in names]
        run.__signature__ = signature.replace(parameters=kept)
        return run

    return decorate

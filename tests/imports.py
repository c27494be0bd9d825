"""Import of a model with the fields of all option records as keywords, so that a test changes one of them."""

from dataclasses import fields

from bdamper.importers import BuiltModel, Checks, FEBody, Placement, Reduction, Sector, build_model

RECORDS = {"sector": Sector, "placement": Placement, "reduction": Reduction, "checks": Checks}


def build(*bodies: FEBody, **settings: object) -> BuiltModel:
    """``build_model`` with flat keywords."""
    for name, record in RECORDS.items():
        own = {
            field.name: settings.pop(field.name)
            for field in fields(record)
            if field.name in settings
        }
        settings |= {name: record(**own)} if own else {}
    return build_model(*bodies, **settings)

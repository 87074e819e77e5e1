"""Text that the pages of the validation share."""

ENDING = """## How to make this page

    {command}

It writes this page, its table, its figure and a record with machine, versions and commit; without `--full` it takes the coarse
size of CI. `python -m runout.studies.documentation` makes the same files again from the record in `tests/benchmarks/records/`.
"""

"""Published benchmarks: box, columns, sparsity ladder and a large synthetic site -> our numbers beside the published ones -> page.

    python pipelines/seed_ladder.py OUT [DEVICE]

`runout bench --published` is the command; `--full` there uses the sizes of the documentation.
"""

import sys
from pathlib import Path

from runout.io.atomic import write_json
from runout.studies.published_benchmarks import FILE, measured
from runout.studies.seed_cases.page import page, tables


def main(out: Path, device: str = "cpu") -> Path:
    """Path of the page, after running every benchmark in its small size on a device."""
    record = measured(device)  # boxes on slopes, columns of sand, two bodies ever farther apart, 9.3 Mm3 that fall 1000 m
    for title, table in tables([record]):
        print(f"{title}\n\n{table}\n")
    write_json(record, out / FILE)
    return page([record]).write(out)


if __name__ == "__main__":
    print(main(Path(sys.argv[1]), *sys.argv[2:3]))

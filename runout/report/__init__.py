"""The report of a study: maps over hillshade, figures and one self-contained page.

:func:`runout.report.html.write_report` writes it; :mod:`runout.report.maps` and :mod:`runout.report.figures` draw,
:mod:`runout.report.study` reads what the other stages left in the results folder.
"""

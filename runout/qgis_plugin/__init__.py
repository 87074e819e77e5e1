"""Plugin of QGIS: algorithms of the processing toolbox that call the command ``runout`` of the user's own environment.

``runout qgis-plugin`` writes this folder as a zip. It runs in the Python of QGIS (3.9 and newer) and imports nothing of runout.
"""


def classFactory(iface):
    """The plugin, for QGIS."""
    from .provider import Plugin

    return Plugin()

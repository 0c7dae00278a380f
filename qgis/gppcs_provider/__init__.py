"""A plugin of QGIS: thin point clouds, make meshes and evaluate both with gppcs, in the Processing toolbox."""


def classFactory(iface):
    """Return the plugin, as QGIS asks for it."""
    from .provider import Plugin

    return Plugin()

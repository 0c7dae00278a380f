"""The plugin, and the provider of its algorithms."""

from processing.core.ProcessingConfig import ProcessingConfig, Setting
from qgis.core import QgsApplication, QgsProcessingProvider

from .algorithms import Evaluate, MakeMesh, Thin
from .command import NAME, SETTING


class Provider(QgsProcessingProvider):
    """The algorithms of gppcs, and a setting of Processing: where the command is."""

    def id(self):
        return NAME

    def name(self):
        return NAME

    def load(self):
        path = Setting(NAME, SETTING, "Command gppcs (found on the PATH if empty)", "", valuetype=Setting.FILE)
        ProcessingConfig.addSetting(path)
        ProcessingConfig.readSettings()
        self.refreshAlgorithms()
        return True

    def unload(self):
        ProcessingConfig.removeSetting(SETTING)

    def loadAlgorithms(self):
        for algorithm in (Thin, MakeMesh, Evaluate):
            self.addAlgorithm(algorithm())


class Plugin:
    """What QGIS loads and unloads."""

    def initProcessing(self):
        self.provider = Provider()
        QgsApplication.processingRegistry().addProvider(self.provider)

    def initGui(self):
        self.initProcessing()

    def unload(self):
        QgsApplication.processingRegistry().removeProvider(self.provider)

"""The algorithms: what each asks, and the command that it runs."""

import json
import shlex

from qgis.core import (
    QgsProcessingAlgorithm,
    QgsProcessingOutputNumber,
    QgsProcessingParameterEnum,
    QgsProcessingParameterFile,
    QgsProcessingParameterFileDestination,
    QgsProcessingParameterNumber,
    QgsProcessingParameterString,
)

from .command import run

CLOUDS = "Point clouds (*.las *.laz *.ply *.e57 *.pcd *.xyz *.txt *.csv *.ptx *.npy *.parquet);;All files (*)"
SIZE_HELP = "a number such as 5000 or 5k, or a share such as 5%"
METHODS = [
    "gp", "gp-spectral", "fps-variation", "top-variation", "fps", "random", "hc", "wlop", "sample-elimination", "voxel",
    "aivs", "pc-simp", "qem",
]  # fmt: skip
FIGURES = ("surface_mean", "surface_p95", "surface_max", "feature_error", "covering_radius", "covering_p999")


class _Algorithm(QgsProcessingAlgorithm):
    """What the algorithms share."""

    title = help = ""

    def createInstance(self):
        return type(self)()

    def name(self):
        return self.title.lower().replace(" ", "_")

    def displayName(self):
        return self.title

    def shortHelpString(self):
        return self.help

    def ask_for_file(self, name, title):
        self.addParameter(QgsProcessingParameterFile(name, title, fileFilter=CLOUDS))

    def ask_for_options(self, command):
        title = f"Further options of the command gppcs {command}"
        self.addParameter(QgsProcessingParameterString("OPTIONS", title, optional=True))

    def text(self, parameters, name, context):
        return self.parameterAsString(parameters, name, context).strip()

    def written(self, command, size, parameters, context, feedback):
        """Run a command that makes a file of a cloud, and return the file."""
        output = self.parameterAsFileOutput(parameters, "OUTPUT", context)
        source = self.text(parameters, "INPUT", context)
        options = shlex.split(self.text(parameters, "OPTIONS", context))
        feedback.pushInfo(run([command, source, "-o", output, "--force", *size, *options], feedback))
        return {"OUTPUT": output}

    def size(self, parameters, context):
        size = self.text(parameters, "SIZE", context)
        return ["--ratio" if "%" in size or size.startswith(("0", ".")) else "--points", size]


class Thin(_Algorithm):
    """Writes a cloud of fewer points."""

    title = "Thin point cloud"
    help = (
        "Keeps exactly as many points as you ask for, each with all its attributes, and more of them where the surface "
        "has detail. The method gp takes the feature weight: 0 keeps points evenly, 1 at features only."
    )

    def initAlgorithm(self, configuration=None):
        self.ask_for_file("INPUT", "Point cloud")
        self.addParameter(QgsProcessingParameterString("SIZE", f"Points to keep: {SIZE_HELP}", "5%"))
        method = QgsProcessingParameterEnum("METHOD", "Method", METHODS, defaultValue="gp", usesStaticStrings=True)
        self.addParameter(method)
        number = QgsProcessingParameterNumber
        weight = number("WEIGHT", "Feature weight of gp", number.Type.Double, 0.5, minValue=0, maxValue=1)
        self.addParameter(weight)
        self.ask_for_options("simplify")
        files = "LAZ files (*.laz);;LAS files (*.las);;PLY files (*.ply);;All files (*)"
        self.addParameter(QgsProcessingParameterFileDestination("OUTPUT", "Thinned point cloud", files))

    def processAlgorithm(self, parameters, context, feedback):
        method = self.parameterAsEnumString(parameters, "METHOD", context)
        weight = self.parameterAsDouble(parameters, "WEIGHT", context)
        chosen = ["--method", method, *(["--set", f"feature_weight={weight}"] if method == "gp" else [])]
        return self.written("simplify", [*self.size(parameters, context), *chosen], parameters, context, feedback)


class MakeMesh(_Algorithm):
    """Writes a mesh of a cloud."""

    title = "Make mesh"
    help = "Makes a light mesh straight from a dense point cloud. Its vertices are points of the cloud."

    def initAlgorithm(self, configuration=None):
        self.ask_for_file("INPUT", "Point cloud")
        self.addParameter(QgsProcessingParameterString("SIZE", f"Vertices: {SIZE_HELP}", "5%"))
        self.ask_for_options("mesh")
        files = "PLY files (*.ply);;OBJ files (*.obj);;STL files (*.stl);;glTF files (*.glb)"
        self.addParameter(QgsProcessingParameterFileDestination("OUTPUT", "Mesh", files))

    def processAlgorithm(self, parameters, context, feedback):
        return self.written("mesh", self.size(parameters, context), parameters, context, feedback)


class Evaluate(_Algorithm):
    """Measures how good a thinned cloud is."""

    title = "Evaluate"
    help = (
        "Measures how far the points of a cloud are from the surface that the points of a thinned cloud span, and how "
        "large its gaps are. Lengths are in the unit of the coordinates."
    )

    def initAlgorithm(self, configuration=None):
        self.ask_for_file("INPUT", "Original point cloud")
        self.ask_for_file("THINNED", "Thinned point cloud")
        for name in FIGURES:
            self.addOutput(QgsProcessingOutputNumber(name.upper(), name.replace("_", " ")))

    def processAlgorithm(self, parameters, context, feedback):
        files = [self.text(parameters, name, context) for name in ("INPUT", "THINNED")]
        figures = json.loads(run(["evaluate", *files, "--json"], feedback))["figures"]
        for name, value in figures.items():
            feedback.pushInfo(f"{name.replace('_', ' ')}: {value if value is None else format(value, '.6g')}")
        return {name.upper(): figures[name] for name in FIGURES}

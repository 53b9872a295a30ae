"""A scripted module for 3D Slicer: thickness and curve skeleton of a segment or a model.

Put this file into a folder of its own, add that under Edit > Application Settings > Modules >
Additional module paths, and start Slicer anew; the module is in the category Surface Models. It
installs medialis into Slicer's Python when it is first used.
"""

import numpy as np
import vtk
from vtk.util.numpy_support import numpy_to_vtk, vtk_to_numpy

try:
    import qt
    import slicer
    from slicer.ScriptedLoadableModule import (
        ScriptedLoadableModule,
        ScriptedLoadableModuleLogic,
        ScriptedLoadableModuleWidget,
    )
except ImportError:  # outside of Slicer: the functions below need VTK alone
    ScriptedLoadableModule = ScriptedLoadableModuleLogic = ScriptedLoadableModuleWidget = object


def arrays_of(polydata: vtk.vtkPolyData) -> tuple[np.ndarray, np.ndarray]:
    """Return the points and triangles of polydata, polygons and strips split."""
    split = vtk.vtkTriangleFilter()
    split.SetInputData(polydata)
    split.PassLinesOff()
    split.PassVertsOff()
    split.Update()
    made = split.GetOutput()
    corners = vtk_to_numpy(made.GetPolys().GetConnectivityArray())
    return vtk_to_numpy(made.GetPoints().GetData()), corners.reshape(-1, 3)


def with_thickness(polydata: vtk.vtkPolyData, minimum: float) -> tuple[vtk.vtkPolyData, list]:
    """Return a copy with the array "thickness", in millimetres, and the spots below a minimum."""
    import medialis

    points, faces = arrays_of(polydata)
    shape = medialis.make_shape(points, faces, repair=True, unit="mm")
    result = medialis.run("thickness", shape, threshold=f"{minimum}mm")
    values = np.array(result.layers[0].attributes["wall_thickness"])
    # Repair welds and drops points: -1 marks those that no triangle uses.
    known = shape.vertex_map >= 0
    on_given = np.full(len(points), np.nan)
    on_given[known] = values[shape.vertex_map[known]]
    made = vtk.vtkPolyData()
    made.DeepCopy(polydata)
    column = numpy_to_vtk(on_given, deep=True)
    column.SetName("thickness")
    made.GetPointData().SetScalars(column)
    return made, [spot for spot in result.values["spots"] if spot["kind"] == "wall"]


def curve_of(polydata: vtk.vtkPolyData) -> vtk.vtkPolyData:
    """Return the curve skeleton as lines with the arrays "radius" and "branch"."""
    import medialis

    points, faces = arrays_of(polydata)
    curve = medialis.run("curve_skeleton", (points, faces)).graph
    made, places, lines = vtk.vtkPolyData(), vtk.vtkPoints(), vtk.vtkCellArray()
    places.SetData(numpy_to_vtk(np.array(curve.nodes), deep=True))
    for a, b in curve.edges.tolist():
        lines.InsertNextCell(2, [a, b])
    made.SetPoints(places)
    made.SetLines(lines)
    for name, values, data in (
        ("radius", curve.radii, made.GetPointData()),
        ("branch", curve.branch, made.GetCellData()),
    ):
        column = numpy_to_vtk(np.array(values), deep=True)
        column.SetName(name)
        data.AddArray(column)
    return made


class MedialisThickness(ScriptedLoadableModule):
    """What Slicer's list of modules shows."""

    def __init__(self, parent) -> None:
        super().__init__(parent)
        self.parent.title = "Medialis Thickness"
        self.parent.categories = ["Surface Models"]
        self.parent.helpText = "Wall thickness and curve skeleton of a model, by medialis."


class MedialisThicknessLogic(ScriptedLoadableModuleLogic):
    """Adds what is computed to the scene."""

    def run(self, polydata: vtk.vtkPolyData, name: str, minimum: float) -> None:
        """Add a model by thickness, its curve skeleton, and a point at each thin spot."""
        try:
            import medialis  # noqa: F401
        except ImportError:
            slicer.util.pip_install("medialis")
        walls, spots = with_thickness(polydata, minimum)
        models = slicer.modules.models.logic()
        for made, text in ((walls, "thickness"), (curve_of(polydata), "curve skeleton")):
            models.AddModel(made).SetName(f"{name} {text}")
        marks = slicer.mrmlScene.AddNewNodeByClass("vtkMRMLMarkupsFiducialNode", f"{name} thin")
        for spot in spots:
            marks.AddControlPoint(spot["position"], f"{spot['value']:.2f} mm")


class MedialisThicknessWidget(ScriptedLoadableModuleWidget):
    """A list of models and segmentations, the minimum, a button."""

    def setup(self) -> None:
        """Build the panel."""
        super().setup()
        self.input = slicer.qMRMLNodeComboBox()
        self.input.nodeTypes = ["vtkMRMLModelNode", "vtkMRMLSegmentationNode"]
        self.input.setMRMLScene(slicer.mrmlScene)
        self.minimum = qt.QDoubleSpinBox()
        self.minimum.value = 1.0
        button = qt.QPushButton("Apply")
        button.connect("clicked()", self.apply)
        for widget in (qt.QLabel("Model or segmentation; minimum in mm"), self.input,
                       self.minimum, button):  # fmt: skip
            self.layout.addWidget(widget)

    def apply(self) -> None:
        """Compute what is chosen; each segment of a segmentation is a shape."""
        node, logic = self.input.currentNode(), MedialisThicknessLogic()
        if node.IsA("vtkMRMLModelNode"):
            logic.run(node.GetPolyData(), node.GetName(), self.minimum.value)
            return
        node.CreateClosedSurfaceRepresentation()
        for number in node.GetSegmentation().GetSegmentIDs():
            polydata = vtk.vtkPolyData()
            node.GetClosedSurfaceRepresentation(number, polydata)
            name = node.GetSegmentation().GetSegment(number).GetName()
            logic.run(polydata, name, self.minimum.value)

#include "mesh_layers.h"

#include <vcg/complex/allocate.h>

#include <algorithm>
#include <cmath>
#include <limits>

namespace {

using Allocator = vcg::tri::Allocator<CMeshO>;

// The two kinds of elements that carry fields, under one set of names.
struct Vertices {
    static int masks() { return MeshModel::MM_VERTCOLOR | MeshModel::MM_VERTQUALITY; }
    static size_t size(CMeshO& mesh) { return mesh.vert.size(); }
    static CMeshO::VertexType& at(CMeshO& mesh, size_t i) { return mesh.vert[i]; }
    template <typename T>
    static CMeshO::PerVertexAttributeHandle<T> fresh(CMeshO& mesh, const std::string& name)
    {
        Allocator::DeletePerVertexAttribute(mesh, name);  // of an earlier run, of any type
        return Allocator::AddPerVertexAttribute<T>(mesh, name);
    }
};

struct Faces {
    static int masks() { return MeshModel::MM_FACECOLOR | MeshModel::MM_FACEQUALITY; }
    static size_t size(CMeshO& mesh) { return mesh.face.size(); }
    static CMeshO::FaceType& at(CMeshO& mesh, size_t i) { return mesh.face[i]; }
    template <typename T>
    static CMeshO::PerFaceAttributeHandle<T> fresh(CMeshO& mesh, const std::string& name)
    {
        Allocator::DeletePerFaceAttribute(mesh, name);
        return Allocator::AddPerFaceAttribute<T>(mesh, name);
    }
};

// The values as quality, which must be finite: MeshLab scales its colours and histograms by the
// smallest and the largest. NaN becomes the smallest finite value, infinity the nearest one.
std::vector<double> asQuality(std::vector<double> values)
{
    double low = std::numeric_limits<double>::infinity(), high = -low;
    for (double value : values)
        if (std::isfinite(value)) {
            low = std::min(low, value);
            high = std::max(high, value);
        }
    if (low > high) low = high = 0.0;
    for (double& value : values)
        value = std::isnan(value) ? low : std::min(std::max(value, low), high);
    return values;
}

template <typename Elements>
int putRows(MeshModel& model, const Rows& rows, const std::string& colorBy)
{
    CMeshO& mesh = model.cm;
    std::vector<size_t> places;  // elements that MeshLab has marked as deleted have no row
    for (size_t i = 0; i < Elements::size(mesh); ++i)
        if (!Elements::at(mesh, i).IsD()) places.push_back(i);
    for (const Attribute& attribute : rows.attributes) {
        const double* value = attribute.values.data();
        if (attribute.width == 3) {
            auto handle = Elements::template fresh<Point3m>(mesh, attribute.name);
            for (size_t i : places) {
                handle[i] = Point3m(Scalarm(value[0]), Scalarm(value[1]), Scalarm(value[2]));
                value += 3;
            }
        } else {
            auto handle = Elements::template fresh<Scalarm>(mesh, attribute.name);
            for (size_t i : places) handle[i] = Scalarm(*value++);
        }
    }
    const Attribute* scalar = rows.find(colorBy);
    if (!scalar && rows.colors.empty()) return 0;
    model.updateDataMask(Elements::masks());
    const std::vector<double> quality = asQuality(scalar ? scalar->values : std::vector<double>());
    for (size_t row = 0; row < places.size(); ++row) {
        auto& element = Elements::at(mesh, places[row]);
        if (scalar) element.Q() = Scalarm(quality[row]);
        if (!rows.colors.empty()) {
            const auto& c = rows.colors[row];
            element.C() = vcg::Color4b(c[0], c[1], c[2], c[3]);
        }
    }
    return Elements::masks();
}

}  // namespace

size_t vertexCount(const CMeshO& mesh) { return size_t(mesh.vn); }
size_t faceCount(const CMeshO& mesh) { return size_t(mesh.fn); }

void writeMesh(const CMeshO& mesh, const QString& path)
{
    std::vector<std::array<double, 3>> points, normals;
    std::vector<std::array<int, 3>> triangles;
    std::vector<int> number(mesh.vert.size(), -1);
    const bool cloud = mesh.fn == 0;
    const vcg::Matrix44d toWorld = vcg::Matrix44d::Construct(mesh.Tr);
    // Normals go with the inverse transpose, which keeps them upright under any scaling.
    const vcg::Matrix33d turn(vcg::Inverse(toWorld).transpose(), 3);
    bool directed = false;  // a cloud that was read without normals has zeros
    for (size_t i = 0; i < mesh.vert.size(); ++i) {
        if (mesh.vert[i].IsD()) continue;
        number[i] = int(points.size());
        const vcg::Point3d p = toWorld * vcg::Point3d::Construct(mesh.vert[i].cP());
        points.push_back({{p[0], p[1], p[2]}});
        if (!cloud) continue;
        const vcg::Point3d n = turn * vcg::Point3d::Construct(mesh.vert[i].cN());
        normals.push_back({{n[0], n[1], n[2]}});
        directed = directed || n.SquaredNorm() > 0;
    }
    if (!directed) normals.clear();
    for (const auto& face : mesh.face) {
        if (face.IsD()) continue;
        std::array<int, 3> corners;
        for (int k = 0; k < 3; ++k)
            corners[k] = number[size_t(face.cV(k) - mesh.vert.data())];
        triangles.push_back(corners);
    }
    writeShape(path, points, normals, triangles);
}

int fillMesh(MeshModel& model, const LayerFile& layer, const std::string& colorBy)
{
    CMeshO& mesh = model.cm;
    Allocator::AddVertices(mesh, layer.points.size());
    for (size_t i = 0; i < layer.points.size(); ++i) {
        const auto& p = layer.points[i];
        mesh.vert[i].P() = Point3m(Scalarm(p[0]), Scalarm(p[1]), Scalarm(p[2]));
    }
    Allocator::AddFaces(mesh, layer.triangles.size());
    for (size_t i = 0; i < layer.triangles.size(); ++i)
        for (int k = 0; k < 3; ++k)
            mesh.face[i].V(k) = &mesh.vert[size_t(layer.triangles[i][k])];
    Allocator::AddEdges(mesh, layer.edges.size());
    for (size_t i = 0; i < layer.edges.size(); ++i)
        for (int k = 0; k < 2; ++k)
            mesh.edge[i].V(k) = &mesh.vert[size_t(layer.edges[i][k])];
    const int changed = putFields(model, layer, colorBy);
    model.MEDIALIS_UPDATE_NORMALS();
    // Points and curves have no normals: lit by zeros they would be all but black.
    if (layer.triangles.empty()) model.clearDataMask(MeshModel::MM_VERTNORMAL);
    return changed;
}

int putFields(MeshModel& model, const LayerFile& layer, const std::string& colorBy)
{
    const int onVertices = putRows<Vertices>(model, layer.vertices, colorBy);
    return onVertices | putRows<Faces>(model, layer.faces, colorBy);
}

int select(MeshModel& model, const LayerFile& layer)
{
    const Attribute* chosen = layer.vertices.find("selected");
    if (!chosen) throw Problem("The result tells no selection.");
    size_t row = 0;
    for (auto& vertex : model.cm.vert) {
        if (vertex.IsD()) continue;
        if (chosen->values[row++] == 1.0)
            vertex.SetS();
        else
            vertex.ClearS();
    }
    return MeshModel::MM_VERTFLAGSELECT;
}

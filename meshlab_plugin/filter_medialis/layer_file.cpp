#include "layer_file.h"

#include <QFile>
#include <QtEndian>

#include <limits>
#include <map>
#include <sstream>

namespace {

const int BLOCK = 1 << 22;

struct Property {
    std::string type, name;
    bool list = false;
};

struct Element {
    std::string name;
    size_t rows = 0;
    std::vector<Property> properties;
};

struct Header {
    std::vector<Element> elements;
    std::map<std::string, std::string> shapes[2];  // attribute -> SHAPE, of vertices and of faces
    int body = 0;
};

size_t sizeOf(const std::string& type)
{
    static const std::map<std::string, size_t> sizes = {
        {"char", 1}, {"uchar", 1}, {"short", 2}, {"ushort", 2},
        {"int", 4}, {"uint", 4}, {"float", 4}, {"double", 8}};
    const auto found = sizes.find(type);
    if (found == sizes.end()) throw Problem("Unknown PLY type " + QString::fromStdString(type) + ".");
    return found->second;
}

template <typename T> T load(const char* at) { return qFromLittleEndian<T>(at); }

double number(const std::string& type, const char* at)
{
    if (type == "double") return load<double>(at);
    if (type == "float") return load<float>(at);
    if (type == "int") return load<qint32>(at);
    if (type == "uint") return load<quint32>(at);
    if (type == "short") return load<qint16>(at);
    if (type == "ushort") return load<quint16>(at);
    return type == "char" ? double(static_cast<signed char>(*at))
                          : double(static_cast<unsigned char>(*at));
}

Header readHeader(const QByteArray& data)
{
    Header header;
    const char end[] = "end_header\n";
    const int found = data.indexOf(end);
    if (!data.startsWith("ply\nformat binary_little_endian 1.0\n") || found < 0)
        throw Problem("The result is not a PLY file as medialis writes it.");
    header.body = found + int(sizeof(end)) - 1;
    std::istringstream lines(data.left(found).toStdString());
    for (std::string line; std::getline(lines, line);) {
        std::istringstream words(line);
        std::string first, name, type, shape;
        words >> first >> name >> type;
        if (first == "comment" && (name == "medialis" || name == "medialis_face")) {
            std::string dtype;
            if (words >> dtype >> shape) header.shapes[name == "medialis_face"][type] = shape;
        } else if (first == "element") {
            header.elements.push_back({name, size_t(std::stoull(type)), {}});
        } else if (first == "property" && !header.elements.empty()) {
            Property property{name, type, name == "list"};
            if (property.list) {  // property list uchar int vertex_indices
                words >> property.type >> property.name;
                if (type != "uchar" || property.type != "int")
                    throw Problem("Unknown kind of PLY list in the result.");
            }
            header.elements.back().properties.push_back(property);
        }
    }
    return header;
}

// Columns of scalars, the row of every list (three corners), and how many bytes were read.
struct Table {
    std::map<std::string, std::vector<double>> columns;
    std::vector<std::string> order;
    std::vector<std::array<int, 3>> corners;
};

Table readTable(const Element& element, const QByteArray& data, size_t& position)
{
    Table table;
    size_t stride = 0;
    for (const Property& property : element.properties) {
        stride += property.list ? 1 + 3 * 4 : sizeOf(property.type);
        if (!property.list) table.order.push_back(property.name);
    }
    if (position + stride * element.rows > size_t(data.size()))
        throw Problem("The result file is cut short.");
    size_t offset = 0;
    for (const Property& property : element.properties) {
        const char* at = data.constData() + position + offset;
        if (property.list) {
            table.corners.resize(element.rows);
            for (size_t i = 0; i < element.rows; ++i, at += stride) {
                if (*at != 3) throw Problem("The result has a face that is no triangle.");
                for (int k = 0; k < 3; ++k) table.corners[i][k] = load<qint32>(at + 1 + 4 * k);
            }
            offset += 1 + 3 * 4;
        } else {
            std::vector<double>& column = table.columns[property.name];
            column.resize(element.rows);
            for (size_t i = 0; i < element.rows; ++i, at += stride)
                column[i] = number(property.type, at);
            offset += sizeOf(property.type);
        }
    }
    position += stride * element.rows;
    return table;
}

// Scalars of the table as attributes: `name_0 name_1 name_2` become one of width 3.
Rows attributesOf(Table& table, size_t count, const std::map<std::string, std::string>& shapes)
{
    Rows rows;
    rows.count = count;
    if (table.columns.count("alpha")) {
        rows.colors.resize(count);
        const char* names[] = {"red", "green", "blue", "alpha"};
        for (int k = 0; k < 4; ++k) {
            const std::vector<double>& column = table.columns[names[k]];
            for (size_t i = 0; i < count; ++i) rows.colors[i][k] = (unsigned char)column.at(i);
            table.columns.erase(names[k]);
        }
    }
    for (const auto& shape : shapes) {
        const std::string& name = shape.first;
        if (shape.second != "3" || !table.columns.count(name + "_2")) continue;
        Attribute attribute{name, 3, std::vector<double>(3 * count)};
        for (int k = 0; k < 3; ++k) {
            const std::string part = name + "_" + std::to_string(k);
            for (size_t i = 0; i < count; ++i)
                attribute.values[3 * i + k] = table.columns.at(part)[i];
            table.columns.erase(part);
        }
        rows.attributes.push_back(std::move(attribute));
    }
    for (const std::string& name : table.order)
        if (table.columns.count(name))
            rows.attributes.push_back({name, 1, std::move(table.columns[name])});
    return rows;
}

template <size_t N> void check(const std::vector<std::array<int, N>>& rows, size_t count)
{
    for (const auto& row : rows)
        for (const int corner : row)
            if (corner < 0 || size_t(corner) >= count)
                throw Problem("The result names a point that is not there.");
}

void append(QByteArray& data, const void* value, size_t size)
{
    data.append(static_cast<const char*>(value), int(size));
}

template <typename T> void appendNumber(QByteArray& data, T value)
{
    const T little = qToLittleEndian(value);
    append(data, &little, sizeof(T));
}

}  // namespace

const Attribute* Rows::find(const std::string& name) const
{
    for (const Attribute& attribute : attributes)
        if (attribute.name == name && attribute.width == 1) return &attribute;
    return nullptr;
}

LayerFile readLayer(const QString& path)
{
    QFile file(path);
    if (!file.open(QIODevice::ReadOnly))
        throw Problem("Cannot read the result: " + file.errorString() + ".");
    if (file.size() > std::numeric_limits<int>::max())
        throw Problem("The result has more than 2 GB, which MeshLab's plugin cannot read; use the "
                      "command line.");
    const QByteArray data = file.readAll();
    const Header header = readHeader(data);
    LayerFile layer;
    size_t position = size_t(header.body);
    for (const Element& element : header.elements) {
        Table table = readTable(element, data, position);
        if (element.name == "vertex") {
            const auto x = table.columns.at("x"), y = table.columns.at("y"),
                       z = table.columns.at("z");
            layer.points.resize(element.rows);
            for (size_t i = 0; i < element.rows; ++i) layer.points[i] = {{x[i], y[i], z[i]}};
            for (const char* name : {"x", "y", "z"}) table.columns.erase(name);
            layer.vertices = attributesOf(table, element.rows, header.shapes[0]);
        } else if (element.name == "face") {
            layer.triangles = table.corners;
            layer.faces = attributesOf(table, element.rows, header.shapes[1]);
        } else if (element.name == "edge") {
            const auto a = table.columns.at("vertex1"), b = table.columns.at("vertex2");
            layer.edges.resize(element.rows);
            for (size_t i = 0; i < element.rows; ++i) layer.edges[i] = {{int(a[i]), int(b[i])}};
        }
    }
    check(layer.triangles, layer.points.size());
    check(layer.edges, layer.points.size());
    return layer;
}

void writeShape(const QString& path, const std::vector<std::array<double, 3>>& points,
                const std::vector<std::array<double, 3>>& normals,
                const std::vector<std::array<int, 3>>& triangles)
{
    QByteArray data = "ply\nformat binary_little_endian 1.0\nelement vertex ";
    data += QByteArray::number(qulonglong(points.size()));
    data += "\nproperty double x\nproperty double y\nproperty double z\n";
    if (!normals.empty()) data += "property double nx\nproperty double ny\nproperty double nz\n";
    if (!triangles.empty()) {
        data += "element face " + QByteArray::number(qulonglong(triangles.size()));
        data += "\nproperty list uchar int vertex_indices\n";
    }
    data += "end_header\n";
    QFile file(path);
    bool good = file.open(QIODevice::WriteOnly);
    // In blocks: one QByteArray holds at most 2 GB.
    const auto flush = [&](int limit) {
        if (data.size() < limit) return;
        good = good && file.write(data) == data.size();
        data.clear();
    };
    for (size_t i = 0; i < points.size(); ++i, flush(BLOCK)) {
        for (const double value : points[i]) appendNumber(data, value);
        if (!normals.empty())
            for (const double value : normals[i]) appendNumber(data, value);
    }
    for (const auto& triangle : triangles) {
        data.append(char(3));
        for (const int corner : triangle) appendNumber(data, qint32(corner));
        flush(BLOCK);
    }
    flush(0);
    if (!good || !file.flush())
        throw Problem("Cannot write the layer for medialis to " + path + ": " +
                      file.errorString() + ".");
}

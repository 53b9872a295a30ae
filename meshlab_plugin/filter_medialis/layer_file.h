// Layers as files: what the medialis command line reads and writes (binary little-endian PLY).
#pragma once

#include <QString>

#include <array>
#include <stdexcept>
#include <string>
#include <vector>

// Everything that ends a filter with a sentence for the user.
struct Problem : std::runtime_error {
    explicit Problem(const QString& sentence) : std::runtime_error(sentence.toStdString()) {}
};

// A named column, a number a row, or three a row (`width` 3).
struct Attribute {
    std::string name;
    int width = 1;
    std::vector<double> values;
};

struct Rows {
    size_t count = 0;
    std::vector<Attribute> attributes;      // without the colours
    std::vector<std::array<unsigned char, 4>> colors;  // empty, or one a row

    const Attribute* find(const std::string& name) const;
};

struct LayerFile {
    std::vector<std::array<double, 3>> points;
    Rows vertices;
    std::vector<std::array<int, 3>> triangles;
    Rows faces;
    std::vector<std::array<int, 2>> edges;
};

LayerFile readLayer(const QString& path);

// `normals` is empty or has a row a point.
void writeShape(const QString& path, const std::vector<std::array<double, 3>>& points,
                const std::vector<std::array<double, 3>>& normals,
                const std::vector<std::array<int, 3>>& triangles);

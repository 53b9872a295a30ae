// What a row of the generated filter_table.h holds.
#pragma once

#include <string>
#include <vector>

enum class Kind { Float, Int, Bool, Choice, Length, Angle, File };

struct ParameterEntry {
    const char* name;    // Python name; the command line writes it with dashes
    Kind kind;
    double number;       // default: a number, 0 or 1, or the index of a choice
    const char* text;    // choices joined by |, or the default of a file
    const char* label;
    const char* help;
    bool advanced;
};

struct FilterEntry {
    const char* command;  // of the command line
    const char* title;    // menu entry
    const char* help;
    const char* verb;     // first word of the MeshLab-style name: says where the menu entry goes
    bool needs_faces;
    std::vector<ParameterEntry> parameters;
};

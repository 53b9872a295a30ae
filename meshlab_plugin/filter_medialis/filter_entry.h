// The filters, as `medialis meshlab-install` has written them beside the plugin.
#pragma once

#include <QString>
#include <QStringList>

#include <vector>

enum class Kind { Float, Int, Bool, Choice, Length, Angle, File, Text };

struct ParameterEntry {
    QString name;         // Python name; the command line writes it with dashes
    Kind kind;
    double number;        // default: a number, 0 or 1, or the index of a choice
    QString text;         // default of a text, "auto": what is written there goes on as it is
    double low, high;     // range of a number
    QStringList choices;
    QString label, help;
    QString selection;    // "pair" or "each": a file for the selected vertices
    bool advanced;
};

struct FilterEntry {
    QString command;      // of the command line
    QString name;         // in Python, verb first
    QString title;        // menu entry
    QString help;
    bool selects;         // selects vertices, adds nothing
    bool needsFaces;
    std::vector<ParameterEntry> parameters;      // of the operation
    std::vector<ParameterEntry> hostParameters;  // of what only a host can do; off in scripts

    bool generates() const { return name.startsWith("generate_"); }
    bool hasHost(const char* parameter) const;
};

// Read medialis-filters.json beside the plugin; none where there is no such file.
std::vector<FilterEntry> readFilters();

#include "filter_entry.h"

#include "medialis_program.h"

#include <QDir>
#include <QFile>
#include <QJsonArray>
#include <QJsonDocument>
#include <QJsonObject>

#include <algorithm>

namespace {

Kind kindOf(const QString& name)
{
    static const QStringList names = {"float", "int", "bool", "choice", "length", "angle", "file",
                                       "text"};
    return Kind(std::max(0, names.indexOf(name)));
}

ParameterEntry parameterOf(const QJsonObject& about)
{
    ParameterEntry entry;
    entry.name = about["name"].toString();
    entry.kind = kindOf(about["kind"].toString());
    entry.low = about["low"].toDouble();
    entry.high = about["high"].toDouble();
    for (const QJsonValue& choice : about["choices"].toArray())
        entry.choices << choice.toString();
    const QJsonValue standard = about["default"];
    entry.text = standard.toString();
    if (entry.kind == Kind::Choice)
        entry.number = entry.choices.indexOf(standard.toString());
    else
        entry.number = standard.isBool() ? double(standard.toBool()) : standard.toDouble();
    entry.label = about["label"].toString();
    entry.help = about["help"].toString();
    entry.selection = about["selection"].toString();
    entry.advanced = about["advanced"].toBool();
    return entry;
}

std::vector<ParameterEntry> parametersOf(const QJsonValue& rows)
{
    std::vector<ParameterEntry> found;
    for (const QJsonValue& row : rows.toArray()) found.push_back(parameterOf(row.toObject()));
    return found;
}

}  // namespace

bool FilterEntry::hasHost(const char* parameter) const
{
    for (const ParameterEntry& entry : hostParameters)
        if (entry.name == parameter) return true;
    return false;
}

std::vector<FilterEntry> readFilters()
{
    std::vector<FilterEntry> filters;
    QFile file(QDir(pluginFolder()).filePath("medialis-filters.json"));
    if (!file.open(QIODevice::ReadOnly)) return filters;
    const QJsonObject table = QJsonDocument::fromJson(file.readAll()).object();
    for (const QJsonValue& value : table["filters"].toArray()) {
        const QJsonObject about = value.toObject();
        FilterEntry entry;
        entry.command = about["command"].toString();
        entry.name = about["name"].toString();
        entry.title = about["title"].toString();
        entry.help = about["help"].toString();
        entry.selects = about["selects"].toBool();
        entry.needsFaces = about["needs_faces"].toBool();
        entry.parameters = parametersOf(about["parameters"]);
        entry.hostParameters = parametersOf(about["host_parameters"]);
        filters.push_back(entry);
    }
    return filters;
}

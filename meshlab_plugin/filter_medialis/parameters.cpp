#include "parameters.h"

#include "layer_file.h"

#include <QCoreApplication>
#include <QDir>
#include <QFile>

#include <cmath>

namespace {

// What a length is per cent of; the dialog shows both, scripts keep it beside the value.
double diagonal(const CMeshO& mesh)
{
    const double found = double(mesh.trBB().Diag());
    return found > 0.0 && std::isfinite(found) ? found : 1.0;
}

QString flag(const QString& name) { return "--" + QString(name).replace('_', '-'); }

QString text(double value) { return QString::number(value, 'g', 6); }  // within MeshLab's float

void add(const ParameterEntry& p, double size, double number, RichParameterList& list)
{
    switch (p.kind) {
    case Kind::Length:
        list.addParam(RichLength(p.name, Scalarm(number * size), 0, Scalarm(size), p.label,
                                 p.help MEDIALIS_ADVANCED(p.advanced)));
        break;
    case Kind::Float:
    case Kind::Angle:
        list.addParam(
            RichFloat(p.name, Scalarm(number), p.label, p.help MEDIALIS_ADVANCED(p.advanced)));
        break;
    case Kind::Int:
        list.addParam(RichInt(p.name, int(number), p.label, p.help MEDIALIS_ADVANCED(p.advanced)));
        break;
    case Kind::Bool:
        list.addParam(
            RichBool(p.name, number != 0, p.label, p.help MEDIALIS_ADVANCED(p.advanced)));
        break;
    case Kind::Choice:
        list.addParam(RichEnum(p.name, int(number), p.choices, p.label,
                               p.help MEDIALIS_ADVANCED(p.advanced)));
        break;
    case Kind::File:
        list.addParam(RichFileOpen(p.name, "", QStringList{"*.*"}, p.label,
                                   p.help MEDIALIS_ADVANCED(p.advanced)));
        break;
    case Kind::Text:
        list.addParam(
            RichString(p.name, p.text, p.label, p.help MEDIALIS_ADVANCED(p.advanced)));
        break;
    }
}

// The dialog shows lengths to some 5e-7 of the diagonal, and per cent with three decimals: what was
// typed is the nearest of these.
double asTyped(double fraction)
{
    const double typed = std::round(1e5 * fraction) / 1e5;
    return inDialogs() && std::abs(fraction - typed) < 6e-7 ? typed : fraction;
}

// A number as the operation takes it: lengths as fractions of the diagonal that they came with.
double numberOf(const ParameterEntry& p, const RichParameterList& values)
{
    switch (p.kind) {
    case Kind::Length: {
        const auto& given = static_cast<const RichLength&>(values.getParameterByName(p.name));
        const double size = double(given.max);
        return asTyped(double(values.getAbsPerc(p.name)) / (size > 0.0 ? size : 1.0));
    }
    case Kind::Int: return values.getInt(p.name);
    case Kind::Bool: return values.getBool(p.name);
    case Kind::Choice: return values.getEnum(p.name);
    default: return double(values.getFloat(p.name));
    }
}

void checkRange(const ParameterEntry& p, double number, double size)
{
    const double rounding = 1e-6 * std::abs(number);
    if (p.kind == Kind::Bool || p.kind == Kind::Choice || p.kind == Kind::File ||
        (number >= p.low - rounding && number <= p.high + rounding))
        return;
    if (p.kind == Kind::Length)
        throw Problem(QString("%1 must be %2 % to %3 % of the diagonal (%4 to %5), got %6 % (%7).")
                          .arg(p.label, text(100 * p.low), text(100 * p.high), text(p.low * size),
                               text(p.high * size), text(100 * number), text(number * size)));
    throw Problem(QString("%1 must be %2 to %3, got %4.")
                      .arg(p.label, text(p.low), text(p.high), text(number)));
}

QString argument(const ParameterEntry& p, double number)
{
    switch (p.kind) {
    case Kind::Bool: return (number != 0 ? "--" : "--no-") + flag(p.name).mid(2);
    case Kind::Choice: return flag(p.name) + "=" + p.choices.value(int(number));
    case Kind::Length: return flag(p.name) + "=" + text(100 * number) + "%";
    default: return flag(p.name) + "=" + text(number);  // one word: a value may start with -
    }
}

// The selected vertices as the operation reads them; no file where none is selected.
QString selectionFile(const CMeshO& mesh, const QString& how, const QString& folder)
{
    QStringList numbers;
    int row = 0;
    for (const auto& vertex : mesh.vert) {
        if (vertex.IsD()) continue;
        if (vertex.IsS()) numbers << QString::number(row);
        ++row;
    }
    if (numbers.isEmpty()) return QString();
    if (how == "pair" && numbers.size() != 2)
        throw Problem(QString("Select two vertices, or none: %1 are selected.").arg(numbers.size()));
    const QString path = QDir(folder).filePath("selected.txt");
    QFile file(path);
    const QByteArray content = numbers.join(how == "pair" ? " " : "\n").toUtf8() + "\n";
    if (!file.open(QIODevice::WriteOnly) || file.write(content) != content.size())
        throw Problem("Cannot write the selection to " + path + ": " + file.errorString() + ".");
    return path;
}

}  // namespace

bool inDialogs() { return QCoreApplication::instance() != nullptr; }

void addParameters(const FilterEntry& filter, const MeshModel& model, RichParameterList& list)
{
    const double size = diagonal(model.cm);
    for (const ParameterEntry& p : filter.parameters) add(p, size, p.number, list);
    for (const ParameterEntry& p : filter.hostParameters)
        add(p, size, inDialogs() ? p.number : 0.0, list);
}

QStringList argumentsOf(const FilterEntry& filter, const RichParameterList& values,
                        const CMeshO& mesh, const QString& folder)
{
    QStringList arguments;
    const bool selected = filter.hasHost("use_selection") && values.getBool("use_selection");
    for (const ParameterEntry& p : filter.parameters) {
        if (p.kind == Kind::File) {
            QString path = values.getOpenFileName(p.name);
            if (path.isEmpty() && selected && !p.selection.isEmpty())
                path = selectionFile(mesh, p.selection, folder);
            if (!path.isEmpty()) arguments << flag(p.name) + "=" + path;
            continue;
        }
        if (p.kind == Kind::Text) {  // the command line checks it
            const QString text = values.getString(p.name).trimmed();
            if (!text.isEmpty() && text != p.text) arguments << flag(p.name) + "=" + text;
            continue;
        }
        const double number = numberOf(p, values);
        checkRange(p, number, diagonal(mesh));
        // The default stays the operation's own, without the rounding of dialogs.
        if (std::abs(number - p.number) > 2e-6 * std::abs(p.number)) arguments << argument(p, number);
    }
    if (filter.selects) arguments << "--select";
    if (filter.hasHost("auxiliary_layers") && values.getBool("auxiliary_layers"))
        arguments << "--auxiliary";
    if (filter.hasHost("solid") && values.getBool("solid")) arguments << "--solid";
    return arguments;
}

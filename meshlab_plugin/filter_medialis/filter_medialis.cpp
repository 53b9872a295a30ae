#include "filter_medialis.h"

#include "filter_table.h"
#include "medialis_program.h"
#include "mesh_layers.h"

#include <QAction>
#include <QCoreApplication>
#include <QDir>
#include <QEvent>
#include <QFile>
#include <QJsonArray>
#include <QJsonDocument>
#include <QJsonObject>
#include <QKeyEvent>
#include <QTemporaryDir>

#include <cmath>

namespace {

const char HIDE[] = "hide_source", AUXILIARY[] = "auxiliary_layers";

// While the child runs, MeshLab stays drawn but takes no input: Escape cancels, and nothing can
// start a second filter inside this one or close the document under it.
class HeldInput : public QObject {
public:
    HeldInput() : application_(QCoreApplication::instance())
    {
        if (application_) application_->installEventFilter(this);
    }
    ~HeldInput() override
    {
        if (application_) application_->removeEventFilter(this);
    }
    // MeshLab's own progress callback draws at times only, and always says to go on.
    bool goesOn()
    {
        if (application_) application_->processEvents();
        return !cancelled_;
    }

protected:
    bool eventFilter(QObject*, QEvent* event) override
    {
        switch (event->type()) {
        case QEvent::KeyPress:
        case QEvent::ShortcutOverride:
            if (static_cast<QKeyEvent*>(event)->key() == Qt::Key_Escape) cancelled_ = true;
            return true;
        case QEvent::Close:
            event->ignore();
            return true;
        case QEvent::KeyRelease:
        case QEvent::Shortcut:
        case QEvent::MouseButtonPress:
        case QEvent::MouseButtonRelease:
        case QEvent::MouseButtonDblClick:
        case QEvent::Wheel:
        case QEvent::ContextMenu:
        case QEvent::Drop:
            return true;
        default:
            return false;
        }
    }

private:
    QCoreApplication* application_;
    bool cancelled_ = false;
};

// Lengths of the command line are fractions of the diagonal; those of MeshLab are absolute.
double diagonal(const MeshModel& model)
{
    const double found = double(model.cm.trBB().Diag());
    return found > 0.0 && std::isfinite(found) ? found : 1.0;
}

QString flag(const char* name) { return "--" + QString(name).replace('_', '-'); }

QString text(double value) { return QString::number(value, 'g', 7); }  // beyond the float of MeshLab

QStringList argumentsOf(const FilterEntry& filter, const RichParameterList& values, double size)
{
    QStringList arguments;
    for (const ParameterEntry& parameter : filter.parameters) {
        const QString name = parameter.name;
        QString value;
        switch (parameter.kind) {
        case Kind::Length: value = text(double(values.getAbsPerc(name)) / size); break;
        case Kind::Float:
        case Kind::Angle: value = text(double(values.getFloat(name))); break;
        case Kind::Int: value = QString::number(values.getInt(name)); break;
        case Kind::Choice: value = QString(parameter.text).split('|').value(values.getEnum(name)); break;
        case Kind::File: value = values.getOpenFileName(name); break;
        case Kind::Bool:
            arguments << (values.getBool(name) ? flag(parameter.name)
                                               : "--no-" + flag(parameter.name).mid(2));
            continue;
        }
        arguments << flag(parameter.name) + "=" + value;  // one word: a value may start with -
    }
    return arguments;
}

void addParameters(const FilterEntry& filter, const MeshModel& model, RichParameterList& list)
{
    const double size = diagonal(model);
    for (const ParameterEntry& p : filter.parameters) {
        switch (p.kind) {
        case Kind::Length:
            list.addParam(RichLength(p.name, Scalarm(p.number * size), 0, Scalarm(size), p.label,
                                     p.help MEDIALIS_ADVANCED(p.advanced)));
            break;
        case Kind::Float:
        case Kind::Angle:
            list.addParam(RichFloat(p.name, Scalarm(p.number), p.label,
                                    p.help MEDIALIS_ADVANCED(p.advanced)));
            break;
        case Kind::Int:
            list.addParam(
                RichInt(p.name, int(p.number), p.label, p.help MEDIALIS_ADVANCED(p.advanced)));
            break;
        case Kind::Bool:
            list.addParam(
                RichBool(p.name, p.number != 0, p.label, p.help MEDIALIS_ADVANCED(p.advanced)));
            break;
        case Kind::Choice:
            list.addParam(RichEnum(p.name, int(p.number), QString(p.text).split('|'), p.label,
                                   p.help MEDIALIS_ADVANCED(p.advanced)));
            break;
        case Kind::File:
            list.addParam(RichFileOpen(p.name, p.text, QStringList{"*.*"}, p.label,
                                       p.help MEDIALIS_ADVANCED(p.advanced)));
            break;
        }
    }
    list.addParam(RichBool(HIDE, true, "Hide the shape",
                           "Hide the layer that was computed from, so that the new one inside it "
                           "can be seen."));
    list.addParam(RichBool(AUXILIARY, false, "Add the samples",
                           "Also add the surface as it was computed on; numbers of feature points "
                           "and sources are rows of this layer." MEDIALIS_ADVANCED(true)));
}

QJsonObject readManifest(const QDir& folder)
{
    QFile file(folder.filePath("manifest.json"));
    file.open(QIODevice::ReadOnly);
    const QJsonObject manifest = QJsonDocument::fromJson(file.readAll()).object();
    if (!manifest.contains("layers")) throw Problem("The medialis program left no result.");
    return manifest;
}

// Plain numbers and positions are what scripts can read; tables stay in the layers.
QVariant returned(const QJsonValue& value)
{
    if (value.isBool()) return value.toBool();
    if (value.isDouble()) {
        const double number = value.toDouble();
        if (number == std::floor(number) && std::abs(number) < 2e9) return int(number);
        return number;
    }
    return QVariant();
}

struct NewLayer {
    QString name;
    std::string colorBy;
    bool onInput, hidden;
    LayerFile content;
};

// All files are read and checked before the first layer is added.
std::vector<NewLayer> readLayers(const QJsonObject& manifest, const QDir& folder,
                                 const MeshModel& source)
{
    std::vector<NewLayer> layers;
    for (const QJsonValue& value : manifest["layers"].toArray()) {
        const QJsonObject about = value.toObject();
        NewLayer layer{about["name"].toString(), about["color_by"].toString().toStdString(),
                       about["on_input"].toBool(), about["role"].toString() == "hidden",
                       readLayer(folder.filePath(about["file"].toString()))};
        const Rows& faces = layer.content.faces;
        const bool lies = layer.content.points.size() == vertexCount(source.cm) &&
                          (faces.attributes.empty() || faces.count == faceCount(source.cm));
        if (layer.onInput && !lies) throw Problem("The fields of the result do not fit the layer.");
        layers.push_back(std::move(layer));
    }
    return layers;
}

// The given layer stays the current one: Apply in the dialog can be pressed again. New layers come
// first, because they can be taken back when memory runs out; those that start invisible (points
// that the operation hides) before the others, so that the last layer is one of the result's own.
// Returns what changed on the given one.
int addLayers(const std::vector<NewLayer>& layers, MeshModel& source, MeshDocument& document)
{
    std::vector<MeshModel*> added;
    try {
        for (const bool hidden : {true, false})
            for (const NewLayer& layer : layers) {
                if (layer.onInput || layer.hidden != hidden) continue;
                added.push_back(document.addNewMesh("", layer.name, false));
                fillMesh(*added.back(), layer.content, layer.colorBy);
                if (hidden) document.setVisible(int(added.back()->id()), false);
            }
    } catch (...) {
        for (MeshModel* model : added) removeLayer(document, model);
        throw;
    }
    int changed = MeshModel::MM_NONE;
    for (const NewLayer& layer : layers)
        if (layer.onInput) changed |= putFields(source, layer.content, layer.colorBy);
    return changed;
}

}  // namespace

FilterMedialis::FilterMedialis()
{
    for (size_t id = 0; id < FILTERS.size(); ++id) {
        typeList.push_back(FilterId(id));
        actionList.push_back(new QAction(filterName(FilterId(id)), this));
    }
}

QString FilterMedialis::filterName(FilterId id) const { return FILTERS.at(size_t(id)).title; }

QString FilterMedialis::filterInfo(FilterId id) const
{
    return QString(FILTERS.at(size_t(id)).help).toHtmlEscaped().replace("\n\n", "<br/><br/>");
}

const FilterEntry& FilterMedialis::entry(FilterAction* action) const
{
    return FILTERS.at(size_t(ID(action)));
}

MEDIALIS_PLUGIN_CLASS::FilterClass FilterMedialis::classOf(FilterAction* action) const
{
    const std::string verb = entry(action).verb;
    if (verb == "compute") return Quality;
    if (verb == "get") return Measure;
    return Remeshing;
}

int FilterMedialis::getPreConditions(FilterAction* action) const
{
    return entry(action).needs_faces ? MeshModel::MM_FACENUMBER : MeshModel::MM_NONE;
}

FilterMedialis::Values FilterMedialis::run(const FilterEntry& filter,
                                           const RichParameterList& values,
                                           MeshDocument& document, vcg::CallBackPos* progress)
{
    changed_ = MeshModel::MM_NONE;
    MeshModel* source = document.mm();
    if (!source) throw Problem("There is no layer to compute from: open a shape first.");
    if (source->cm.vn == 0)
        throw Problem("The layer " + source->label() + " has no points: choose another layer.");
    QTemporaryDir folder(QDir::temp().filePath("medialis-XXXXXX"));
    if (!folder.isValid())
        throw Problem("Cannot make a folder in " + QDir::tempPath() + ": " + folder.errorString() +
                      ".");
    const QString input = folder.filePath("in.ply"), output = folder.filePath("out");
    QStringList arguments = {filter.command, input, "--output", output, "--host", "--progress",
                             "lines"};
    if (values.getBool(AUXILIARY)) arguments << "--auxiliary";
    arguments << argumentsOf(filter, values, diagonal(*source));
    std::vector<NewLayer> layers;
    QJsonObject manifest;
    try {
        HeldInput held;
        writeMesh(source->cm, input);
        runMedialis(arguments, [&](int percent, const QString& stage) {
            const QByteArray words = stage.toUtf8();
            return (!progress || progress(percent, words.constData())) && held.goesOn();
        });
        manifest = readManifest(output);
        layers = readLayers(manifest, output, *source);
    } catch (const Problem& problem) {  // the user knows the layer, not the file we wrote
        throw Problem(QString::fromUtf8(problem.what()).replace(input, source->label()));
    }
    changed_ = addLayers(layers, *source, document);
    if (!layers.empty() && !layers.front().onInput && values.getBool(HIDE))
        document.setVisible(int(source->id()), false);
    for (const QJsonValue& message : manifest["messages"].toArray())
        MEDIALIS_LOG(message.toString().toStdString());
    Values result;
    const QJsonObject found = manifest["values"].toObject();
    for (auto it = found.begin(); it != found.end(); ++it) {
        const QVariant value = returned(it.value());
        if (!value.isValid()) continue;
        result[it.key().toStdString()] = value;
        MEDIALIS_LOG((it.key() + ": " + value.toString()).toStdString());
    }
    return result;
}

#ifdef MEDIALIS_MESHLAB_2020
void FilterMedialis::initParameterSet(QAction* action, MeshModel& model, RichParameterList& list)
{
    addParameters(entry(action), model, list);
}

bool FilterMedialis::applyFilter(QAction* action, MeshDocument& document,
                                 const RichParameterList& values, vcg::CallBackPos* progress)
{
    try {
        run(entry(action), values, document, progress);
        return true;
    } catch (const std::bad_alloc&) {
        throw;
    } catch (const std::exception& error) {
        const QString sentence = QString::fromUtf8(error.what());
        MEDIALIS_LOG(sentence.toStdString());
        errorMessage = sentence.toHtmlEscaped();
        return false;
    }
}
#else
RichParameterList FilterMedialis::initParameterList(FilterAction* action, const MeshModel& model)
{
    RichParameterList list;
    addParameters(entry(action), model, list);
    return list;
}

std::map<std::string, QVariant> FilterMedialis::applyFilter(FilterAction* action,
                                                            const RichParameterList& values,
                                                            MeshDocument& document,
                                                            unsigned int& changed,
                                                            vcg::CallBackPos* progress)
{
    try {
        const Values result = run(entry(action), values, document, progress);
        changed = unsigned(changed_);
        return result;
    } catch (const std::bad_alloc&) {
        throw;
    } catch (const std::exception& error) {
        throw MLException(QString::fromUtf8(error.what()));
    }
}
#endif

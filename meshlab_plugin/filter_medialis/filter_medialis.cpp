#include "filter_medialis.h"

#include "held_input.h"
#include "medialis_program.h"
#include "mesh_layers.h"
#include "parameters.h"

#include <QAction>
#include <QDir>
#include <QFile>
#include <QJsonArray>
#include <QJsonDocument>
#include <QJsonObject>
#include <QTemporaryDir>

#include <cmath>

namespace {

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
    QString role;
    bool onInput;
    LayerFile content;

    bool hidden() const { return role == "hidden"; }
    bool selection() const { return role == "selection"; }
};

// All files are read and checked before the first layer is added.
std::vector<NewLayer> readLayers(const QJsonObject& manifest, const QDir& folder,
                                 const MeshModel& source)
{
    std::vector<NewLayer> layers;
    for (const QJsonValue& value : manifest["layers"].toArray()) {
        const QJsonObject about = value.toObject();
        NewLayer layer{about["name"].toString(), about["color_by"].toString().toStdString(),
                       about["role"].toString(), about["on_input"].toBool(),
                       readLayer(folder.filePath(about["file"].toString()))};
        const Rows& faces = layer.content.faces;
        const bool lies = layer.content.points.size() == vertexCount(source.cm) &&
                          (faces.attributes.empty() || faces.count == faceCount(source.cm));
        if (layer.onInput && !lies) throw Problem("The fields of the result do not fit the layer.");
        layers.push_back(std::move(layer));
    }
    return layers;
}

struct Computed {
    QJsonObject manifest;
    std::vector<NewLayer> layers;
};

// Hand the layer over, run the operation, read all that it left; nothing has changed in MeshLab.
Computed compute(const FilterEntry& filter, const RichParameterList& values,
                 const MeshModel& source, vcg::CallBackPos* progress)
{
    QTemporaryDir folder(QDir::temp().filePath("medialis-XXXXXX"));
    if (!folder.isValid())
        throw Problem("Cannot make a folder in " + QDir::tempPath() + ": " + folder.errorString() +
                      ".");
    const QString input = folder.filePath("in.ply"), output = folder.filePath("out");
    QStringList arguments = {filter.command, input, "--output", output, "--host", "--progress",
                             "lines"};
    arguments << argumentsOf(filter, values, source.cm, folder.path());
    try {
        HeldInput held;
        writeMesh(source.cm, input);
        runMedialis(arguments, [&](int percent, const QString& stage) {
            const QByteArray words = stage.toUtf8();
            return (!progress || progress(percent, words.constData())) && held.goesOn();
        });
        const QJsonObject manifest = readManifest(output);
        return {manifest, readLayers(manifest, output, source)};
    } catch (const Problem& problem) {  // the user knows the layer, not the file we wrote
        throw Problem(QString::fromUtf8(problem.what()).replace(input, source.label()));
    }
}

// New layers come first, because they can be taken back when memory runs out; those that start
// invisible (points that the operation hides) before the others, so that the last layer is one of
// the result's own. In dialogs the given layer stays the current one: Apply can be pressed again. In
// scripts a generated one becomes it, as everywhere in pymeshlab. Returns what changed on the given.
int addLayers(const FilterEntry& filter, const std::vector<NewLayer>& layers, MeshModel& source,
              MeshDocument& document)
{
    std::vector<MeshModel*> added;
    MeshModel* first = nullptr;
    try {
        for (const bool hidden : {true, false})
            for (const NewLayer& layer : layers) {
                if (layer.onInput || layer.hidden() != hidden) continue;
                added.push_back(document.addNewMesh("", layer.name, false));
                fillMesh(*added.back(), layer.content, layer.colorBy);
                if (hidden) document.setVisible(int(added.back()->id()), false);
                if (!hidden && !first) first = added.back();
            }
    } catch (...) {
        for (MeshModel* model : added) removeLayer(document, model);
        throw;
    }
    int changed = MeshModel::MM_NONE;
    for (const NewLayer& layer : layers)
        if (layer.selection())
            changed |= select(source, layer.content);
        else if (layer.onInput)
            changed |= putFields(source, layer.content, layer.colorBy);
    if (first && filter.generates() && !inDialogs()) document.setCurrentMesh(int(first->id()));
    return changed;
}

}  // namespace

FilterMedialis::FilterMedialis() : filters_(readFilters())
{
    for (size_t id = 0; id < filters_.size(); ++id) {
        typeList.push_back(FilterId(id));
        actionList.push_back(new QAction(filterName(FilterId(id)), this));
    }
}

QString FilterMedialis::filterName(FilterId id) const { return filters_.at(size_t(id)).title; }

QString FilterMedialis::filterInfo(FilterId id) const
{
    return filters_.at(size_t(id)).help.toHtmlEscaped().replace("\n\n", "<br/><br/>");
}

const FilterEntry& FilterMedialis::entry(FilterAction* action) const
{
    return filters_.at(size_t(ID(action)));
}

MEDIALIS_PLUGIN_CLASS::FilterClass FilterMedialis::classOf(FilterAction* action) const
{
    const FilterEntry& filter = entry(action);
    if (filter.selects) return Selection;
    return filter.generates() ? Remeshing : Quality;
}

int FilterMedialis::getPreConditions(FilterAction* action) const
{
    return entry(action).needsFaces ? MeshModel::MM_FACENUMBER : MeshModel::MM_NONE;
}

// What MeshLab draws anew of the given layer: all of it, or nothing. Where this told of fields alone,
// MeshLab would offer a preview, which runs the filter. (Later ones ask `applyFilter` what changed.)
int FilterMedialis::postCondition(FilterAction* action) const
{
    return entry(action).generates() ? MeshModel::MM_NONE : MeshModel::MM_VERTNUMBER;
}

FilterMedialis::Values FilterMedialis::run(const FilterEntry& filter,
                                           const RichParameterList& values,
                                           MeshDocument& document, unsigned& changed,
                                           vcg::CallBackPos* progress)
{
    MeshModel* source = document.mm();
    if (!source) throw Problem("There is no layer to compute from: open a shape first.");
    if (source->cm.vn == 0)
        throw Problem("The layer " + source->label() + " has no points: choose another layer.");
    const Computed computed = compute(filter, values, *source, progress);
    changed = unsigned(addLayers(filter, computed.layers, *source, document));
    const bool hide = filter.hasHost("hide_source") && values.getBool("hide_source");
    if (hide || !filter.hasHost("hide_source")) document.setVisible(int(source->id()), !hide);
    return logged(computed.manifest);
}

FilterMedialis::Values FilterMedialis::logged(const QJsonObject& manifest)
{
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
        unsigned changed = 0;
        run(entry(action), values, document, changed, progress);
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
        return run(entry(action), values, document, changed, progress);
    } catch (const std::bad_alloc&) {
        throw;
    } catch (const std::exception& error) {
        throw MLException(QString::fromUtf8(error.what()));
    }
}
#endif

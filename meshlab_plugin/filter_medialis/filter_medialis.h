// The plugin: one filter for each operation of medialis, run by its command line.
#pragma once

#include "filter_entry.h"
#include "meshlab_compat.h"

#include <QJsonObject>
#include <QObject>

#include <map>

class FilterMedialis : public QObject, public MEDIALIS_PLUGIN_CLASS {
    Q_OBJECT
#ifdef MEDIALIS_MESHLAB_2020
    MESHLAB_PLUGIN_IID_EXPORTER(MEDIALIS_PLUGIN_IID)
    Q_INTERFACES(MeshFilterInterface)
#else
    MESHLAB_PLUGIN_IID_EXPORTER(MEDIALIS_PLUGIN_IID)
    Q_INTERFACES(FilterPlugin)
#endif

public:
    FilterMedialis();

    QString pluginName() const override { return "FilterMedialis"; }
    QString filterName(FilterId id) const override;
    QString filterInfo(FilterId id) const override;
    FilterArity filterArity(FilterAction*) const override { return SINGLE_MESH; }
    int getPreConditions(FilterAction* action) const override;
    int postCondition(FilterAction* action) const override;

#ifdef MEDIALIS_MESHLAB_2020
    FilterClass getClass(FilterAction* action) override { return classOf(action); }
    void initParameterSet(QAction* action, MeshModel& model, RichParameterList& list) override;
    bool applyFilter(QAction* action, MeshDocument& document, const RichParameterList& values,
                     vcg::CallBackPos* progress) override;
#else
    QString vendor() const override { return "The medialis developers"; }
    QString pythonFilterName(FilterId id) const override { return filters_.at(size_t(id)).name; }
    FilterClass getClass(FilterAction* action) const override { return classOf(action); }
    RichParameterList initParameterList(FilterAction* action, const MeshModel& model) override;
    std::map<std::string, QVariant> applyFilter(FilterAction* action,
                                                const RichParameterList& values,
                                                MeshDocument& document, unsigned int& changed,
                                                vcg::CallBackPos* progress) override;
#endif

private:
    using Values = std::map<std::string, QVariant>;

    const FilterEntry& entry(FilterAction* action) const;
    FilterClass classOf(FilterAction* action) const;
    Values run(const FilterEntry& filter, const RichParameterList& values, MeshDocument& document,
               unsigned& changed, vcg::CallBackPos* progress);
    Values logged(const QJsonObject& manifest);

    std::vector<FilterEntry> filters_;
};

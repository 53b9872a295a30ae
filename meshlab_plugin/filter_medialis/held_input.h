// MeshLab's window while the child runs.
#pragma once

#include <QCoreApplication>
#include <QEvent>
#include <QKeyEvent>
#include <QObject>

// MeshLab stays drawn but takes no input: Escape cancels, and nothing can start a second filter
// inside this one or close the document under it.
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

// The medialis command line as a child process.
#pragma once

#include <QString>
#include <QStringList>

#include <functional>

// Where this plugin lies, with the notes that `medialis meshlab-install` has put beside it.
QString pluginFolder();

// Called with 0..100 and a text, also without news, some 20 times a second; false cancels.
using Report = std::function<bool(int, const QString&)>;

// Run `medialis ARGUMENTS` to its end. Throws a Problem with one sentence when it cannot be
// started, fails, is ended from outside or is cancelled; no child is left then.
void runMedialis(const QStringList& arguments, const Report& report);

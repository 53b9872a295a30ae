#include "medialis_program.h"

#include "layer_file.h"

#include <QDir>
#include <QFile>
#include <QFileInfo>
#include <QProcess>
#include <QProcessEnvironment>

#ifdef Q_OS_WIN
#include <windows.h>
#else
#include <dlfcn.h>
#endif

namespace {

const char INSTALL[] = "run 'medialis meshlab-install' from the Python environment that has it";

// The variable, else the file that `medialis meshlab-install` wrote, else whatever PATH has.
QString chosenProgram()
{
    const QString wanted = qEnvironmentVariable("MEDIALIS_PROGRAM");
    if (!wanted.isEmpty()) return wanted;
    QFile note(QDir(pluginFolder()).filePath("medialis-program.txt"));
    if (note.open(QIODevice::ReadOnly)) {
        const QString noted = QString::fromUtf8(note.readLine()).trimmed();
        if (!noted.isEmpty()) return noted;
    }
    return "medialis";
}

// The host's own libraries, Qt plugins and Python must not reach another program.
QProcessEnvironment cleanEnvironment()
{
    QProcessEnvironment environment = QProcessEnvironment::systemEnvironment();
    for (const QString& name : environment.keys())
        if (name.startsWith("QT_") || name.startsWith("LD_") || name.startsWith("DYLD_") ||
            name == "PYTHONHOME" || name == "PYTHONPATH" || name == "PYTHONSTARTUP")
            environment.remove(name);
    environment.insert("PYTHONIOENCODING", "utf-8");
    return environment;
}

// Ends the child when the filter ends in any way.
struct Child : QProcess {
    ~Child() override
    {
        if (state() == NotRunning) return;
        terminate();
        if (!waitForFinished(3000)) kill();
        waitForFinished(3000);
    }
};

// Takes whole lines out of what the child has said: its progress, its error, anything else.
struct Lines {
    QByteArray rest;
    int percent = 0;
    QString text = "medialis", sentence, last;

    void take(const QByteArray& data)
    {
        rest += data;
        for (int end; (end = rest.indexOf('\n')) >= 0; rest.remove(0, end + 1)) {
            const QString line = QString::fromUtf8(rest.left(end)).trimmed();
            if (line.startsWith("PROGRESS ")) {
                percent = int(100 * line.section(' ', 1, 1).toDouble());
                text = line.section(' ', 2);
            } else if (line.startsWith("medialis: ")) {
                sentence = line.mid(int(sizeof("medialis: ")) - 1);
            } else if (!line.isEmpty()) {
                last = line;
            }
        }
    }
};

QString failure(const QProcess& child, const Lines& lines)
{
    if (child.exitStatus() == QProcess::CrashExit)
        return "The medialis program was ended from outside; nothing was changed.";
    if (!lines.sentence.isEmpty()) return lines.sentence;
    if (lines.last.contains("No module named medialis") ||
        lines.last.contains("No module named 'medialis'"))
        return child.program() + " has no medialis: " + INSTALL + ".";
    return QString("The medialis program failed (exit code %1): %2")
        .arg(child.exitCode())
        .arg(lines.last.isEmpty() ? "it said nothing." : lines.last);
}

}  // namespace

QString pluginFolder()
{
#ifdef Q_OS_WIN
    HMODULE module = nullptr;
    wchar_t name[32768] = {};
    GetModuleHandleExW(GET_MODULE_HANDLE_EX_FLAG_FROM_ADDRESS |
                           GET_MODULE_HANDLE_EX_FLAG_UNCHANGED_REFCOUNT,
                       reinterpret_cast<LPCWSTR>(&pluginFolder), &module);
    GetModuleFileNameW(module, name, 32767);
    return QFileInfo(QString::fromWCharArray(name)).absolutePath();
#else
    Dl_info info = {};
    dladdr(reinterpret_cast<void*>(&pluginFolder), &info);
    return QFileInfo(QFile::decodeName(info.dli_fname)).absolutePath();
#endif
}

void runMedialis(const QStringList& arguments, const Report& report)
{
    const QString program = chosenProgram();
    QStringList all = arguments;
    if (QFileInfo(program).fileName().startsWith("python", Qt::CaseInsensitive))
        all = QStringList{"-m", "medialis"} + arguments;
    Child child;
    child.setProcessEnvironment(cleanEnvironment());
    child.setStandardOutputFile(QProcess::nullDevice());
    child.setStandardInputFile(QProcess::nullDevice());
    child.setReadChannel(QProcess::StandardError);
    child.start(program, all);
    if (!child.waitForStarted())
        throw Problem("Cannot start the medialis program " + program + ": " + INSTALL +
                      ", or set MEDIALIS_PROGRAM to its Python.");
    Lines lines;
    while (child.state() != QProcess::NotRunning) {
        child.waitForReadyRead(50);
        lines.take(child.readAllStandardError());
        if (!report(lines.percent, lines.text)) throw Problem("Cancelled: nothing was changed.");
    }
    lines.take(child.readAllStandardError() + "\n");
    if (child.exitStatus() != QProcess::NormalExit || child.exitCode() != 0)
        throw Problem(failure(child, lines));
}

#pragma once

#include <filesystem>
#include <memory>
#include <string>

#include <kfstab/properties/child_process.hpp>
#include <kfstab/properties/subject.hpp>

/// The doors for filters that are programs or shared libraries: protocol 1, docs/protocol.md.
namespace kfstab::properties {

/// A program that is started by a shell command, and speaks protocol 1 on its standard streams.
///
/// Throws InputError if what it says of itself is not what protocol 1 wants to hear, and SubjectFault. After a fault, and
/// after a line that is none, the next start starts the program anew.
std::unique_ptr<StepwiseFilter> exec_filter(const std::string& command, const Limits& limits = {});

/// A shared library with the functions of kfstab_filter.h. It is loaded by a process of its own, which is run as
/// `HOST plugin-host LIBRARY`: kfstab is such a host, and others make themselves one with serve_plugin (plugin_host.hpp).
/// Without a host this very program is taken for one.
std::unique_ptr<StepwiseFilter> plugin_filter(const std::filesystem::path& library, const Limits& limits = {},
                                              const std::filesystem::path& host = {});

/// The same as subjects of the check engine.
std::unique_ptr<Subject> exec_subject(const std::string& command, const Limits& limits = {});
std::unique_ptr<Subject> plugin_subject(const std::filesystem::path& library, const Limits& limits = {},
                                        const std::filesystem::path& host = {});

}  // namespace kfstab::properties

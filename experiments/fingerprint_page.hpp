#pragma once

#include <string>
#include <vector>

#include <kfstab/experiments/context.hpp>
#include <kfstab/experiments/fingerprint.hpp>
#include <kfstab/reports/document.hpp>

/// Fingerprints for people: the page of `check`.
namespace kfstab::experiments {

/// The slopes, a row a ladder, beside those of the nearest filter of the registry.
reports::Table slope_table(const Fingerprint& fingerprint);

/// The sentence, what it rests on, and the figures: the subject among filters of the registry on each ladder, and the
/// asymmetry of a P. Ids of figures begin with `prefix`.
reports::Section fingerprint_section(const Fingerprint& fingerprint, const std::string& prefix);

/// A section a subject.
reports::Document fingerprint_document(const std::vector<Fingerprint>& fingerprints, const Context& made = context());

}  // namespace kfstab::experiments

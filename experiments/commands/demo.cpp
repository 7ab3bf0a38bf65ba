#include <algorithm>

#include <fmt/core.h>

#include <kfstab/experiments/claim.hpp>
#include <kfstab/experiments/commands/commands.hpp>
#include <kfstab/experiments/interruption.hpp>
#include <kfstab/experiments/output.hpp>
#include <kfstab/experiments/pages.hpp>
#include <kfstab/experiments/progress.hpp>
#include <kfstab/experiments/results.hpp>
#include <kfstab/reports/plot.hpp>

namespace kfstab::experiments {
namespace {

/// The demo's four claims.
constexpr int demo_claims[] = {3, 4, 8, 11};

/// One filter that diverges and one that holds, out of the figure of the divergence claim.
reports::Figure two_filters(const ClaimResult& divergence) {
  reports::Figure figure = divergence.findings.figures.front();
  figure.title = "Two filters, one formula, no perturbation but rounding";
  std::erase_if(figure.curves, [](const reports::Curve& c) { return c.id != "ckf-gain" && c.id != "srcf"; });
  return figure;
}

}  // namespace

int demo_command(const std::string& out) {
  Output output(out, "demo", "");
  std::vector<ClaimResult> results;
  {
    Progress progress("demo", std::ssize(demo_claims));
    std::vector<Claim> claims = all_claims();
    std::erase_if(claims, [](const Claim& claim) { return !std::ranges::count(demo_claims, claim.number); });
    results = run_claims(claims, {}, Effort::full, 0, [&] { progress.advance(); });
  }
  const Context made = context();
  output.write(claims_document(results, made), claims_json(results, {}, made));

  const auto divergence = std::ranges::find(results, 4, [](const ClaimResult& r) { return r.claim.number; });
  if (divergence != results.end()) {
    const auto plot = reports::text_plot(two_filters(*divergence), 100, 28);
    output.print(plot.text.empty() ? fmt::format("(no plot: {})\n", plot.warning) : plot.text);
    const auto growth = std::ranges::find_if(divergence->findings.checks, [](const reports::Check& check) {
      return check.name.starts_with("ckf-gain: growth");
    });
    output.print(fmt::format(
        "\nckf-gain, P+ = A P A' - K Re K' + B Q B', and srcf, which holds a square root of P, are the same filter on paper.\n"
        "In floating point the first rounding that makes P unsymmetric grew by {:.4f} a step; theory says {:.4f}, the product\n"
        "of the two largest eigenvalue moduli of A. srcf cannot lose symmetry.\n\n",
        growth->measured, growth->predicted));
  }
  output.print(verdict_table(results));
  output.print(fmt::format("\nThe report, with every figure: {}\n", output.report().string()));
  output.print(
      "Next, a system of your own:    ./kfstab run mine.toml       (docs/systems.md; ./kfstab list systems for examples)\n"
      "A filter of your own:          ./kfstab check --exec 'python3 examples/textbook.py', and then with yours (docs/protocol.md)\n");
  if (interrupted()) {
    fmt::print(stderr, "kfstab: interrupted; the claims that were finished are written\n");
    return Exit::interrupted;
  }
  const bool confirmed = std::ranges::all_of(
      results, [](const ClaimResult& r) { return r.verdict() == reports::Verdict::confirmed; });
  return confirmed ? Exit::ok : Exit::failed;
}

}  // namespace kfstab::experiments

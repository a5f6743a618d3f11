// What a morph says to the user in sentences: every warning, and why a domain was taken. Not for
// callers of the library.
#pragma once

#include <span>
#include <string>
#include <vector>

#include "morph/prepared_shape.hpp"
#include "pointmorph/morph/morph_input.hpp"
#include "pointmorph/registration/diagnostics.hpp"

namespace pointmorph {

/// What preparing the shapes changed or found: inward normals, strays, different topologies; these
/// not of shapes of several pieces if it is told `by_pieces`, once it is known which belong
/// together.
std::vector<std::string> preparation_warnings(const PreparedShapes& shapes, bool by_pieces);

/// What the source's faces can't do where one shape has a handle and the other none, and what
/// helps; empty otherwise, and where there are several pieces.
std::vector<std::string> handle_warnings(const PreparedShapes& shapes);

/// Of features that method paper can't keep to; empty where there are none.
std::vector<std::string> paper_warnings(std::span<const Feature> features);

std::string faces_were_reversed(const std::string& shape, bool only_some);
std::string normals_disagree();

std::string earlier_map_was_ignored(const std::string& domain);
/// Why an update gave way to a search from scratch.
std::string mark_went_far(const std::string& name, double distance);
std::string update_would_tear();
std::string marks_join_other_parts();
std::string loop_was_suggested(std::span<const std::string> loop);
std::string cut_was_led_around(const std::string& shape, const std::string& features);
std::string curves_take_detours();
/// `what_fits` is subject and verb: "The loop fits".
std::string fits_mirrored(const std::string& what_fits);
std::string patch_has_holes(const std::string& shape, Index boundary_loops);
/// `share` of the points of `whole`, 0 to 1, lie where `part` has ended.
std::string goes_beyond(const std::string& whole, const std::string& part, double share);
std::string separate_parts(const std::string& shape, Index points);
std::string orientation_was_searched(const std::string& source, const std::string& target);
std::string sphere_is_stretched();

/// What may be wrong with a map that isn't sure, and which mark would settle it. `found` and
/// `features` in given rows.
std::string doubts(const Diagnostics& found, const Cloud& source, const Cloud& target,
                   std::span<const Feature> features);

/// Where one of the clouds has colors and the other has none.
std::vector<std::string> color_warnings(const Cloud& source, const Cloud& target);

/// Where straight paths shrink the shape, because the target lies turned against the source.
std::vector<std::string> straight_path_warnings(const Cloud& source, const Cloud& target,
                                                const Pairing& pairs);

/// The domain, and what the shapes are: "product space: closed surfaces of genus 1 and 0".
std::string choice_in_words(const std::string& domain, const Topology& source,
                            const Topology& target);

}  // namespace pointmorph

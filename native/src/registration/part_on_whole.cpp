#include "registration/part_on_whole.hpp"

#include <algorithm>
#include <cmath>
#include <iterator>
#include <numeric>
#include <optional>
#include <utility>
#include <vector>

#include "base/angle.hpp"
#include "base/quietly.hpp"
#include "pointmorph/cloud/cloud.hpp"
#include "pointmorph/cloud/kd_tree.hpp"
#include "pointmorph/registration/product_space.hpp"
#include "pointmorph/surface/surface_graph.hpp"
#include "registration/part_search.hpp"
#include "registration/scene.hpp"

namespace pointmorph {

namespace {

/// Which of the clouds is the part.
struct Sides {
    bool part_is_source;

    template <class Pair>
    auto& part(Pair& pair) const {
        return part_is_source ? pair.source : pair.target;
    }
    template <class Pair>
    auto& whole(Pair& pair) const {
        return part_is_source ? pair.target : pair.source;
    }
    /// Columns of the whole's points in the product space.
    Eigen::Index own() const { return part_is_source ? 0 : 3; }
    Eigen::Index image() const { return part_is_source ? 3 : 0; }
};

constexpr Index kFewestRows = 100;  // of a piece
constexpr double kSmall = 0.8;      // a part, where it lies on the whole, both at area 1
constexpr double kDear = 0.035;     // what a map costs that doesn't fit well

/// What of the whole the part covers where it lies.
struct Cover {
    std::vector<char> cells;  ///< of each coarse point of the whole
    double share = 0.0;       ///< of its area

    /// Whether that is a part of the whole, not nearly all of it, as what half a body covers may
    /// be with its margin.
    bool is_small(double scale) const {
        constexpr double kLargest = 0.7;
        return share < kLargest || scale < kSmall;
    }
};

/// A piece of the whole, laid where the part was given.
struct Piece {
    std::vector<Index> rows;    ///< of the whole
    std::vector<Index> border;  ///< places in `rows` next to what isn't in it
    std::vector<Index> others;  ///< rows of the whole that aren't in it
    Similarity move;            ///< takes the whole, as given, to the part
    Positions positions;
    Normals normals;
};

/// Features whose rows on the whole are all in the piece; none where a feature's aren't.
std::optional<std::vector<Feature>> features_within(std::span<const Feature> features,
                                                    const Sides& sides,
                                                    const std::vector<Index>& rows) {
    std::vector<Feature> result(features.begin(), features.end());
    for (Feature& feature : result)
        for (Index& row : sides.whole(feature).rows) {
            const auto found = std::ranges::lower_bound(rows, row);
            if (found == rows.end() || *found != row) return {};
            row = to_index(found - rows.begin());
        }
    return result;
}

/// What a map costs that the search for the pose has found.
double cost(const Refinement& map, const PoseOptions& options) {
    const Restart& its = map.diagnostics.starts[map.diagnostics.start_taken];
    return its.energy * (1.0 + options.tear_weight * its.torn);
}

/// Both shapes, and the places of the part.
class PartOfWhole {
public:
    PartOfWhole(const GivenClouds& given, const RefinementOptions& options, Progress& progress)
        : given_(given),
          sides_{!given.source.ends.empty()},
          unit_(at_unit_area(given, progress)),
          scene_(scene_of(given, unit_, {}, {}, options, progress)),
          cells_(nearest_rows(KdTree<3>(whole().positions), sides_.whole(unit_).positions)) {}

    const CoarseShape& part() const {
        return sides_.part_is_source ? scene_.coarse_source : scene_.coarse_target;
    }
    const CoarseShape& whole() const {
        return sides_.part_is_source ? scene_.coarse_target : scene_.coarse_source;
    }
    const Sides& sides() const { return sides_; }

    /// What the part covers where it lies, with a margin.
    Cover cover(const PartPlace& place) const {
        constexpr double kMargin = 0.12;
        return with_share(covered_by_part(part(), whole(), place.pose, kMargin));
    }
    /// That, with what hangs on it.
    Piece piece(const PartPlace& place, Cover cover) const {
        cover_what_hangs_on(part(), whole(), place.pose, cover.cells);
        return piece(cover.cells,
                     composed(sides_.part(unit_).placement.inverse(),
                              composed(place.pose.inverse(), sides_.whole(unit_).placement)));
    }

    /// What an earlier map didn't take to an end; none where that is nearly all of the whole.
    std::optional<Piece> piece(const RefinementStart& start) const {
        constexpr double kAtEnd = 1e-6;
        const Positions& images = sides_.part_is_source ? start.target_images : start.source_images;
        const RefinementCloud& cloud = sides_.part(given_);
        const double near = kAtEnd / sides_.part(unit_).placement.scale;
        const Positions ends = gather(cloud.positions, std::span(cloud.ends));
        const std::vector<Index> nearest = nearest_rows(KdTree<3>(ends), images);
        std::vector<char> covered(to_size(whole().size()), 0);
        std::vector<Index> rows;
        for (Index i = 0; i < to_index(nearest.size()); ++i) {
            if ((images.row(i) - ends.row(nearest[to_size(i)])).norm() < near) continue;
            covered[to_size(cells_[to_size(i)])] = 1;
            rows.push_back(i);
        }
        const Positions& places = sides_.whole(given_).positions;
        if (rows.empty()) return {};
        const Similarity move = fit_similarity(gather(places, rows), gather(images, rows));
        const Cover cover = with_share(std::move(covered));
        const double scale =
            sides_.whole(unit_).placement.scale / (move.scale * sides_.part(unit_).placement.scale);
        if (!cover.is_small(scale)) return {};
        return piece(cover.cells, move);
    }

    /// An earlier map as one onto the piece.
    RefinementStart within(const RefinementStart& start, const Piece& piece) const {
        return sides_.part_is_source ? RefinementStart{piece.move.apply(start.source_images),
                                                       gather(start.target_images, piece.rows)}
                                     : RefinementStart{gather(start.source_images, piece.rows),
                                                       piece.move.apply(start.target_images)};
    }

    PartMarks marks(std::span<const Feature> features, Progress& progress) const {
        const Marks found = marks_of(features, {unit_.source.positions, given_.source.normals},
                                     {unit_.target.positions, given_.target.normals}, progress);
        std::vector<Index> on_source, on_target;
        for (const IndexPair& pair : found.pose_pairs) {
            on_source.push_back(pair.source);
            on_target.push_back(pair.target);
        }
        return {
            gather(sides_.part(unit_).positions, sides_.part_is_source ? on_source : on_target),
            gather(sides_.whole(unit_).positions, sides_.part_is_source ? on_target : on_source)};
    }
    Refinement map_onto(const Piece& piece, std::span<const Feature> features,
                        const RefinementOptions& options, Progress& progress,
                        const RefinementStart* start) const {
        const double unit = sides_.part(unit_).placement.scale;
        const RefinementCloud cloud{
            piece.positions, piece.normals, nullptr, {}, 1.0 / (unit * unit)};
        return sides_.part_is_source
                   ? refine(given_.source, cloud, features, options, progress, start)
                   : refine(cloud, given_.target, features, options, progress, start);
    }

    /// A map onto a piece as one onto the whole.
    Refinement with_others(Refinement map, const Piece& piece,
                           std::span<const Feature> features) const;

private:
    Cover with_share(std::vector<char> cells) const {
        double area = 0.0;
        for (std::size_t i = 0; i < cells.size(); ++i)
            if (cells[i] != 0) area += whole().areas[to_index(i)];
        return {std::move(cells), area / whole().areas.sum()};
    }
    Piece piece(const std::vector<char>& covered, const Similarity& move) const {
        std::vector<char> at_border(covered.size(), 0);
        const SurfaceGraph& graph = whole().graph;
        for (Index i = 0; i < graph.size(); ++i)
            for (const Index j : graph[i])
                if (covered[to_size(j)] == 0) at_border[to_size(i)] = 1;
        Piece piece;
        for (std::size_t i = 0; i < cells_.size(); ++i) {
            const auto cell = to_size(cells_[i]);
            if (covered[cell] == 0) {
                piece.others.push_back(to_index(i));
                continue;
            }
            if (at_border[cell] != 0) piece.border.push_back(to_index(piece.rows.size()));
            piece.rows.push_back(to_index(i));
        }
        piece.move = move;
        const RefinementCloud& cloud = sides_.whole(given_);
        piece.positions = piece.move.apply(gather(cloud.positions, piece.rows));
        piece.normals = piece.move.rotated(gather(cloud.normals, piece.rows));
        return piece;
    }

    const GivenClouds given_;
    const Sides sides_;
    const UnitClouds unit_;
    const Scene scene_;
    const std::vector<Index> cells_;  ///< of each point of the whole: the nearest coarse one
};

Refinement PartOfWhole::with_others(Refinement map, const Piece& piece,
                                    std::span<const Feature> features) const {
    const RefinementCloud &part = sides_.part(given_), &whole = sides_.whole(given_);
    Positions& part_images = sides_.part_is_source ? map.source_images : map.target_images;
    Positions& images = sides_.part_is_source ? map.target_images : map.source_images;
    ProductPoints& part_product = sides_.part_is_source ? map.source_product : map.target_product;
    ProductPoints& product = sides_.part_is_source ? map.target_product : map.source_product;
    part_images = piece.move.inverse().apply(part_images);
    for (const IndexPair& pair : pinned_pairs(features))  // to the bit
        part_images.row(sides_.part(pair)) = whole.positions.row(sides_.whole(pair));

    // What isn't in the piece goes to the end that is nearest to where the piece's border goes.
    const std::span<const Index> ends = part.ends;
    const Positions at_ends = gather(part.positions, ends);
    const std::vector<Index> end_of_border =
        nearest_rows(KdTree<3>(at_ends), gather(images, piece.border));
    const Positions at_border = gather(whole.positions, gather(piece.rows, piece.border));
    const Positions others = gather(whole.positions, piece.others);
    const std::vector<Index> beside = nearest_rows(KdTree<3>(at_border), others);

    const Eigen::Index own = sides_.own(), image = sides_.image();
    const Similarity to_product =
        composed(fit_similarity(piece.positions, product.middleCols<3>(own)), piece.move);
    const double weight = product.row(0).segment<3>(own + 6).dot(
        to_product.rotated(gather(whole.normals, std::span(piece.rows).first(1))).row(0));
    Positions all_images(whole.positions.rows(), 3);
    ProductPoints all_product(whole.positions.rows(), product.cols());
    for (std::size_t k = 0; k < piece.rows.size(); ++k) {
        const auto from = static_cast<Eigen::Index>(k);
        all_images.row(piece.rows[k]) = images.row(from);
        all_product.row(piece.rows[k]) = product.row(from);
    }
    const Positions own_places = to_product.apply(others);
    const Normals own_normals = weight * to_product.rotated(gather(whole.normals, piece.others));
    for (std::size_t k = 0; k < piece.others.size(); ++k) {
        const Index row = piece.others[k], end = ends[to_size(end_of_border[to_size(beside[k])])];
        all_images.row(row) = part.positions.row(end);
        auto its = all_product.row(row);
        its.segment<3>(own) = own_places.row(to_index(k));
        its.segment<3>(own + 6) = own_normals.row(to_index(k));
        its.segment<3>(image) = part_product.row(end).segment<3>(image);
        its.segment<3>(image + 6) = part_product.row(end).segment<3>(image + 6);
        map.pairs.push_back(sides_.part_is_source ? IndexPair{end, -1 - row}
                                                  : IndexPair{-1 - row, end});
    }
    images = std::move(all_images);
    product = std::move(all_product);
    for (IndexPair& pair : map.pairs) {
        Index& row = sides_.whole(pair);
        row = row < 0 ? -1 - row : piece.rows[to_size(row)];
    }
    std::ranges::sort(map.pairs);
    std::vector<Index> same(to_size(part.positions.rows()));
    std::iota(same.begin(), same.end(), 0);
    map.diagnostics = sides_.part_is_source ? map.diagnostics.with_rows(same, piece.rows)
                                            : map.diagnostics.with_rows(piece.rows, same);
    map.alignment = sides_.part_is_source ? composed(map.alignment, piece.move)
                                          : composed(piece.move.inverse(), map.alignment);
    return map;
}

/// A map onto a piece, and how well the part fits there.
struct PieceMap {
    Refinement map;
    double cost = 0.0;
};

/// Of the larger one of two sets of coarse points, the share that is in both.
double overlap(const std::vector<char>& a, const std::vector<char>& b) {
    std::ptrdiff_t of_a = 0, of_b = 0, of_both = 0;
    for (std::size_t i = 0; i < a.size(); ++i) {
        of_a += a[i] != 0;
        of_b += b[i] != 0;
        of_both += a[i] != 0 && b[i] != 0;
    }
    return static_cast<double>(of_both) / static_cast<double>(std::max(of_a, of_b));
}

/// A piece that the part may be, and how well it fits there.
struct LikelyPiece {
    Piece piece;
    double misfit;  ///< of the part where it lies
};

/// How unlikely it is that the part lies at a place, by its misfit there and its cover.
double unlikelihood(const PartPlace& place, const Cover& cover) {
    constexpr double kWithMargin = 1.15;  // its own areas that a half covers where it belongs
    // Where an arm lies on a leg, a half covers more than itself; where on nothing, less.
    const double own = kWithMargin * place.pose.scale * place.pose.scale;
    return place.misfit * std::max(cover.share / own, own / cover.share);
}

/// The pieces that are worth a map, the likeliest first, each another one; all of them, or the
/// likeliest of a part that is clearly small.
std::vector<LikelyPiece> likely_pieces(const PartOfWhole& shapes, const PartMarks& marks, bool all,
                                       Progress& progress) {
    constexpr std::size_t kPlaces = 40;
    const std::size_t most = all ? 4 : 1;
    constexpr double kWorthATry = 2.0, kWorthAMap = 1.6, kAsLikely = 1.1, kSame = 0.5;
    const std::vector<PartPlace> places =
        find_part(shapes.part(), shapes.whole(), marks, {kPlaces, !all}, progress);
    std::vector<Cover> covers;                        // of each place
    std::vector<std::pair<double, Index>> by_chance;  // places, the likeliest first
    for (const PartPlace& place : places) {
        if (!progress.poll()) progress.throw_if_cancelled();
        if (place.misfit > kWorthATry * places.front().misfit) break;
        const Cover& cover = covers.emplace_back(shapes.cover(place));
        if (cover.share > 0.0)
            by_chance.emplace_back(unlikelihood(place, cover), to_index(covers.size()) - 1);
    }
    std::ranges::sort(by_chance);
    std::vector<LikelyPiece> pieces;
    std::vector<Index> taken;
    for (const auto& [unlikely, k] : by_chance) {
        const double times = pieces.empty() ? kAsLikely : kWorthAMap;
        if (pieces.size() == most || unlikely > times * by_chance.front().first) break;
        const PartPlace& place = places[to_size(k)];
        const Cover& cover = covers[to_size(k)];
        const auto is_same = [&cover, &covers](Index other) {
            return overlap(covers[to_size(other)].cells, cover.cells) > kSame;
        };
        if (!cover.is_small(place.pose.scale) || std::ranges::any_of(taken, is_same)) continue;
        Piece piece = shapes.piece(place, cover);
        if (to_index(piece.rows.size()) < kFewestRows) continue;
        pieces.push_back({std::move(piece), place.misfit});
        taken.push_back(k);
    }
    return pieces;
}

/// Has a map be doubted for another one, onto another piece, whose cost is `ratio` times its own.
void doubt(Diagnostics& diagnostics, double ratio) {
    // Apart they aren't compared as closely as maps onto the same piece.
    constexpr double kExponent = 0.2, kFar = 1.0;
    OtherMaps& others = diagnostics.alternatives.finished;
    const Eigen::Index count = others.ratios.size();
    others.ratios.conservativeResize(count + 1);
    others.ratios[count] = std::pow(ratio, kExponent);
    const auto add = [&](Eigen::MatrixXd& distances, std::size_t places) {
        distances.conservativeResize(count + 1, static_cast<Eigen::Index>(places));
        distances.row(count).setConstant(kFar);
    };
    add(others.source, diagnostics.alternatives.source_rows.size());
    add(others.target, diagnostics.alternatives.target_rows.size());
}

/// Whether a map rotates the target far from how it was given.
bool is_turned(const Refinement& map, const RefinementCloud& source, const PoseOptions& options) {
    const Similarity implied = fit_similarity(source.positions, map.source_images);
    return angle_axis(implied.rotation).angle() > options.as_given_angle;
}

/// The best of the maps onto likely_pieces(); none where there are none. It is doubted for the
/// others, and where it doesn't fit well.
std::optional<PieceMap> best_on_piece(const PartOfWhole& shapes, const PartMarks& marks,
                                      std::span<const Feature> features, bool all,
                                      const RefinementOptions& options, Progress& progress) {
    constexpr double kCost = 8.0;  // how soon a dearer one doesn't count
    constexpr double kSteep = 4.0;
    std::vector<std::pair<double, PieceMap>> maps;
    for (const LikelyPiece& one : likely_pieces(shapes, marks, all, progress)) {
        const Piece& piece = one.piece;
        const auto mine = features_within(features, shapes.sides(), piece.rows);
        if (!mine) continue;
        Refinement map = shapes.map_onto(piece, *mine, options, progress, nullptr);
        const double its = cost(map, options.pose);
        // Of two hands, which fit alike once they are bent, one fits before that.
        maps.push_back({its * std::sqrt(one.misfit),
                        {shapes.with_others(std::move(map), piece, features), its}});
    }
    if (maps.empty()) return {};
    std::ranges::stable_sort(maps, {}, [](const auto& map) { return map.first; });
    PieceMap& best = maps[0].second;
    double others = std::pow(best.cost / kDear, kSteep);
    for (std::size_t k = 1; k < maps.size(); ++k) {
        const double ratio = maps[k].first / maps[0].first;
        others += std::pow(ratio, -kCost);
        doubt(best.map.diagnostics, ratio);
    }
    best.map.diagnostics.confidence /= 1.0 + others;
    return std::move(best);
}

}  // namespace

PartOrWhole refine_part_or_whole(const RefinementCloud& source, const RefinementCloud& target,
                                 std::span<const Feature> features, const RefinementOptions& given,
                                 Progress& progress, const RefinementStart* start) {
    constexpr double kFits = 0.025;      // what a map costs at most of a shape that lacks little
    constexpr double kFitsWell = 0.012;  // none better is looked for
    // Heads and halves turned any way cost up to .022 on their piece, and .027 or more on any
    // other.
    constexpr double kFitsTurned = 0.0245;
    constexpr double kMuchBetter = 0.75, kBetter = 0.9;
    const bool has_part = source.ends.empty() != target.ends.empty();
    RefinementOptions options = given;
    // How a part lies says nothing of where it belongs, unless it is like nothing of the whole.
    if (has_part) options.pose.as_given = 1.0;
    const auto onto_all = [&] {
        return PartOrWhole{refine(source, target, features, options, progress, start)};
    };
    if (!has_part) return onto_all();
    return quietly(progress, [&](Progress& quiet) -> PartOrWhole {
        if (start) {
            const PartOfWhole shapes({source, target}, options, quiet);
            const std::optional<Piece> piece = shapes.piece(*start);
            if (!piece) return onto_all();
            const auto mine = features_within(features, shapes.sides(), piece->rows);
            if (!mine) return onto_all();
            const RefinementStart own = shapes.within(*start, *piece);
            return {shapes.with_others(shapes.map_onto(*piece, *mine, options, progress, &own),
                                       *piece, features),
                    true};
        }
        std::optional<PartOfWhole> shapes;
        PartMarks marks;
        if (!features.empty()) {
            shapes.emplace(GivenClouds{source, target}, options, quiet);
            marks = shapes->marks(features, quiet);
            if (marks.say_all() && marks.pose().scale < kSmall)
                if (auto best = best_on_piece(*shapes, marks, features, true, options, progress))
                    return {std::move(best->map), true};
        }
        PartOrWhole whole = onto_all();
        const double its = cost(whole.map, options.pose);
        const bool fits = !(its > kFits);
        if (fits && (!(its > kFitsWell) || marks.part.rows() > 0)) return whole;
        if (!shapes) shapes.emplace(GivenClouds{source, target}, options, quiet);
        // Laid out as large as the whole, a half's torso is drawn over hips and legs, which costs
        // little: a cheap map may be wrong, too.
        auto best = best_on_piece(*shapes, marks, features, !fits, options, quiet);
        if (!best) return whole;
        // An open hat fits a piece of a crown or of a turtle as it lies there on its side.
        if (features.empty() && best->cost > kFitsTurned &&
            is_turned(best->map, source, options.pose))
            return whole;
        // Of a shape that is like nothing of the whole, some piece costs less than all of it: heads
        // and halves cost .012 to .017 on theirs, a head or a torus on a piece of the other .054.
        const double dear = std::max(1.0, best->cost / kDear);
        if (!(best->cost * dear * dear < (fits ? kBetter : kMuchBetter) * its)) return whole;
        return {std::move(best->map), true};
    });
}

}  // namespace pointmorph

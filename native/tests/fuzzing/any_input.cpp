#include "fuzzing/any_input.hpp"

#include <algorithm>
#include <cmath>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "fuzzing/bytes.hpp"
#include "mesh_shapes.hpp"
#include "pointmorph/base/error.hpp"
#include "pointmorph/base/parallel.hpp"
#include "pointmorph/cloud/similarity.hpp"
#include "pointmorph/frames/motion.hpp"
#include "pointmorph/frames/stagger.hpp"
#include "pointmorph/morph/cut_preview.hpp"
#include "pointmorph/morph/live_morph.hpp"
#include "pointmorph/morph/loop_suggestion.hpp"
#include "pointmorph/morph/morph.hpp"
#include "pointmorph/morph/network_preview.hpp"
#include "pointmorph/morph/options.hpp"
#include "shapes.hpp"

namespace pointmorph::fuzzing {

namespace {

void promise(bool is_kept, const char* what) {
    if (!is_kept) throw BrokenPromise(what);
}

template <class Numbers>
bool all_finite(const Numbers& numbers) {
    return std::ranges::all_of(numbers, [](double x) { return std::isfinite(x); });
}

// --- Inputs ---

constexpr Index kMostPoints = 48;

/// A small surface, or something that is none.
Cloud surface_of(Bytes& bytes) {
    const Index kind = bytes.below(10), count = 1 + bytes.below(kMostPoints);
    const Index side = 2 + count % 5;
    Cloud cloud;
    if (kind == 0) return mesh_shapes::grid(side);
    if (kind == 1) return mesh_shapes::icosphere(count % 2);
    if (kind == 2) return mesh_shapes::cube();
    if (kind == 3) return mesh_shapes::cylinder(3 + count % 8);
    if (kind == 4) return mesh_shapes::together(mesh_shapes::grid(side), mesh_shapes::cube());
    if (kind == 5) cloud.positions = shapes::grid(side);
    if (kind == 6) cloud.positions = shapes::sphere(count);
    if (kind == 7) cloud.positions = shapes::cube_noise(count, bytes.byte());
    if (kind == 8) cloud.positions = Positions::Ones(count, 3);
    if (kind == 9) {
        cloud.positions.resize(count, 3);
        for (Index i = 0; i < count; ++i)
            cloud.positions.row(i) << bytes.number(), bytes.number(), bytes.number();
    }
    return cloud;
}

void give_attributes(Cloud& cloud, Bytes& bytes) {
    const std::uint8_t flags = bytes.byte();
    const Index count = cloud.size();
    if (flags & 1) {
        cloud.normals = cloud.positions.rowwise() + Eigen::RowVector3d(0.1, 0.2, 0.3);
        cloud.normals *= 0.5 + bytes.share();
    }
    if (flags & 2) cloud.colors = Colors::Constant(count, 4, static_cast<float>(bytes.share()));
    if (flags & 4) cloud.radii = Values::Constant(count, bytes.share());
    if (flags & 8) cloud.faces = {};
    if (flags & 16) cloud.positions *= shapes::rotation(bytes.byte());
    if (flags & 32) {
        constexpr std::array kScales{1e-30, 1e-12, 1e-4, 37.5, 1e5, 1e12, 1e30, 1e-310};
        cloud.positions *= kScales.at(to_size(bytes.below(kScales.size())));
    }
    if (flags & 64) cloud.positions.array() += bytes.number();
}

/// One thing wrong, or at least odd.
void damage(Cloud& cloud, Bytes& bytes) {
    const auto put = [&](auto& rows) {
        if (rows.size() > 0)
            rows(bytes.below(to_index(rows.rows())), bytes.below(to_index(rows.cols()))) =
                static_cast<std::decay_t<decltype(rows(0, 0))>>(bytes.number());
    };
    const auto resize = [&](auto& rows) {
        rows.conservativeResize(std::max<Eigen::Index>(rows.rows() - 1, 0), rows.cols());
    };
    auto& [offsets, corners] = cloud.faces;
    switch (bytes.below(11)) {
        case 0:
            return put(cloud.positions);
        case 1:
            return put(cloud.normals);
        case 2:
            return put(cloud.colors);
        case 3:
            return put(cloud.radii);
        case 4:
            return resize(cloud.positions);
        case 5:
            return resize(cloud.normals);
        case 6:
            return resize(cloud.colors);
        case 7:
            return resize(cloud.radii);
        case 8:
            if (!corners.empty())
                corners[to_size(bytes.below(to_index(corners.size())))] =
                    bytes.row(cloud.size(), true);
            return;
        case 9:
            if (!offsets.empty())
                offsets[to_size(bytes.below(to_index(offsets.size())))] =
                    bytes.row(to_index(corners.size()), true);
            return;
        default:
            if (cloud.size() > 1) {
                const Index from = bytes.below(cloud.size()), to = bytes.below(cloud.size());
                cloud.positions.row(to) = cloud.positions.row(from);
            }
    }
}

Cloud cloud_of(Bytes& bytes, bool may_be_damaged = true) {
    Cloud cloud = surface_of(bytes);
    cloud.name = "a cloud";
    give_attributes(cloud, bytes);
    if (may_be_damaged && bytes.chance(96))
        for (Index more = bytes.below(3); more >= 0; --more) damage(cloud, bytes);
    return cloud;
}

std::string name_of(Bytes& bytes) {
    constexpr std::array kNames{"a", "b", "c", "d", "e", "", "a longer name"};
    return kNames.at(to_size(bytes.below(kNames.size())));
}

Marked marked_of(Bytes& bytes, FeatureKind kind, Index count) {
    Marked marked;
    const Index rows = kind == FeatureKind::kPoint && !bytes.chance(8) ? 1 : bytes.below(6);
    for (Index i = 0; i < rows; ++i) marked.rows.push_back(bytes.row(count, bytes.chance(4)));
    if (bytes.chance(64))
        for (Index i = 0; i < rows; ++i)
            marked.weights.push_back(bytes.chance(8) ? bytes.number() : bytes.share());
    if (bytes.chance(4)) marked.weights.push_back(1.0);
    return marked;
}

std::vector<Feature> features_of(Bytes& bytes, Index source, Index target) {
    std::vector<Feature> features;
    for (Index number = bytes.below(6); number > 0; --number) {
        Feature feature;
        feature.name = bytes.chance(32) ? name_of(bytes) : std::string(1, "_abcdef"[number]);
        feature.kind = static_cast<FeatureKind>(bytes.chance(160) ? 0 : bytes.below(3));
        feature.source = marked_of(bytes, feature.kind, source);
        feature.target = marked_of(bytes, feature.kind, target);
        const std::uint8_t flags = bytes.byte();
        feature.closed = (flags & 7) == 1;
        feature.hard = (flags & 24) != 8;
        if ((flags & 224) == 32) feature.weight = bytes.number();
        features.push_back(std::move(feature));
    }
    return features;
}

std::vector<std::string> loop_of(Bytes& bytes) {
    std::vector<std::string> loop;
    if (bytes.chance(160)) return loop;
    for (Index number = bytes.below(7); number > 0; --number)
        loop.push_back(bytes.chance(16) ? name_of(bytes) : std::string(1, "_abcdefg"[number]));
    return loop;
}

/// Any value, of the right kind more often than not.
OptionValue value_of(Bytes& bytes, const Option& option, bool may_be_damaged) {
    if (may_be_damaged && bytes.chance(48)) {
        const Index kind = bytes.below(4);
        if (kind == 0) return std::monostate{};
        if (kind == 1) return static_cast<std::int64_t>(bytes.row(0, true));
        if (kind == 2) return bytes.number();
        return name_of(bytes);
    }
    if (option.kind == Option::Kind::kChoice)
        return option.choices[to_size(bytes.below(to_index(option.choices.size())))];
    if (option.kind == Option::Kind::kNumber)
        return option.minimum + bytes.share() * (std::min(option.maximum, 1e6) - option.minimum);
    // Rounds and nodes without end take time, and no other way.
    constexpr double kMore = 40.0;
    const double most = std::min(option.maximum, option.minimum + kMore);
    return static_cast<std::int64_t>(option.minimum + bytes.share() * (most - option.minimum));
}

MorphOptions options_of(Bytes& bytes) {
    MorphOptions options;
    const auto& table = option_table();
    for (Index number = bytes.below(6); number > 0; --number) {
        const Option& option = table[to_size(bytes.below(to_index(table.size())))];
        set_option(options, option.name, value_of(bytes, option, false));
    }
    options.threads = 1;  // others are for tests of threads
    return options;
}

Positions places_of(Bytes& bytes, Index rows) {
    Positions places = shapes::cube_noise(std::max<Index>(rows, 1), bytes.byte()).topRows(rows);
    if (rows > 0 && bytes.chance(16)) places(bytes.below(rows), 0) = bytes.number();
    if (bytes.chance(8)) places.conservativeResize(rows + 1 - bytes.below(2) * 2 * (rows > 0), 3);
    return places;
}

Values values_of(Bytes& bytes, Index rows) {
    Values values(rows);
    for (Index i = 0; i < rows; ++i) values[i] = bytes.share();
    if (rows > 0 && bytes.chance(16)) values[bytes.below(rows)] = bytes.number();
    if (bytes.chance(8)) values.conservativeResize(rows + 1);
    return values;
}

Pairing pairs_of(Bytes& bytes, Index source, Index target) {
    Pairing pairs;
    for (Index i = 0; i < std::max(source, target); ++i)
        pairs.push_back({i % std::max<Index>(source, 1), i % std::max<Index>(target, 1)});
    for (Index more = bytes.below(5); more > 0; --more)
        pairs.push_back({bytes.row(source, bytes.chance(4)), bytes.row(target, bytes.chance(4))});
    if (bytes.chance(4) && !pairs.empty()) pairs.pop_back();
    return pairs;
}

Lifetime lifetime_of(Bytes& bytes) {
    std::array<double, 4> times{};
    for (double& time : times) time = bytes.share();
    std::ranges::sort(times);
    if (bytes.chance(16)) times.at(to_size(bytes.below(4))) = bytes.number();
    return {times[0], times[1], times[2], times[3]};
}

ResamplingPlan plan_of(Bytes& bytes, Index pairs) {
    ResamplingPlan plan;
    for (Index number = bytes.below(6); number > 0; --number) {
        InsertedPoint point{};
        for (Index& row : point.pairs) row = bytes.row(pairs, bytes.chance(4));
        const double a = bytes.share(), b = bytes.share() * (1.0 - a);
        point.weights = {a, b, 1.0 - a - b};
        if (bytes.chance(8)) point.weights[0] = bytes.number();
        point.lifetime = lifetime_of(bytes);
        plan.points.push_back(point);
    }
    for (Index number = bytes.below(3); number > 0; --number)
        plan.hidden.push_back({bytes.row(pairs, bytes.chance(4)), lifetime_of(bytes)});
    for (Values* values :
         {&plan.source_spacing, &plan.target_spacing, &plan.source_density, &plan.target_density}) {
        *values = Values::Constant(pairs, 0.01 + bytes.share());
        if (bytes.chance(8) && pairs > 0) (*values)[bytes.below(pairs)] = bytes.number();
        if (bytes.chance(4)) values->conservativeResize(pairs + 1);
    }
    if (bytes.chance(8)) plan.source_size = bytes.number();
    return plan;
}

MorphInput input_of(Bytes& bytes) {
    MorphInput input;
    input.source = cloud_of(bytes);
    input.target = cloud_of(bytes);
    const Index source = input.source.size(), target = input.target.size();
    input.features = features_of(bytes, source, target);
    input.loop = loop_of(bytes);
    const std::uint8_t flags = bytes.byte();
    if ((flags & 3) == 3)
        for (Index number = bytes.below(12); number > 0; --number)
            input.source_boundary.push_back(bytes.row(source, bytes.chance(4)));
    if ((flags & 12) == 12) {
        input.start.source_images = places_of(bytes, source);
        input.start.target_images = places_of(bytes, target);
    }
    if ((flags & 48) == 48)
        for (Index i = 0; i < source; ++i)
            input.source_parts.push_back(bytes.row(3, bytes.chance(2)));
    if ((flags & 192) == 192) {
        input.source_holds.rigid = values_of(bytes, source);
        input.target_holds.fixed = values_of(bytes, target);
        input.delays = values_of(bytes, source);
    }
    if (flags == 77) input.more_loops.push_back(loop_of(bytes));
    return input;
}

// --- What must hold ---

template <class Scalar>
void look_at_frame(const Morph& morph, double t) {
    const std::size_t count = morph.pairs().size();
    std::vector<Scalar> positions(3 * count), normals(3 * count), colors(4 * count), radii(count);
    morph.frame<Scalar>(t, {positions, normals, colors, radii});
    promise(all_finite(positions) && all_finite(normals) && all_finite(radii),
            "a frame has finite numbers");
    if (t != 0.0 && t != 1.0) return;
    for (std::size_t i = 0; i < count; ++i) {
        const IndexPair pair = morph.pairs()[i];
        for (Eigen::Index k = 0; k < 3; ++k) {
            const double end = t == 0.0 ? morph.source().positions(pair.source, k)
                                        : morph.target().positions(pair.target, k);
            promise(positions[3 * i + to_size(k)] == static_cast<Scalar>(end), "ends are exact");
        }
    }
}

void look_at_frames(const Morph& morph, Bytes& bytes, Progress& progress) {
    const double between = bytes.share();
    for (const double t : {0.0, between, 1.0}) {
        look_at_frame<double>(morph, t);
        if (bytes.chance(64)) look_at_frame<float>(morph, t);
    }
    if (bytes.chance(96)) {
        const ResampledFrame<double> frame = morph.resampled_frame<double>(between, progress);
        promise(all_finite(frame.positions) && all_finite(frame.normals) &&
                    all_finite(frame.radii) && all_finite(frame.velocities),
                "a resampled frame has finite numbers");
    }
    if (bytes.chance(8)) look_at_frame<double>(morph, bytes.number());
}

void look_at_pairs(const Morph& morph) {
    std::vector<char> sources(to_size(morph.source().size())), targets;
    targets.resize(to_size(morph.target().size()));
    for (const auto& [s, t] : morph.pairs()) sources.at(to_size(s)) = targets.at(to_size(t)) = 1;
    promise(std::ranges::find(sources, 0) == sources.end() &&
                std::ranges::find(targets, 0) == targets.end(),
            "every point is in a pair");
}

void look_at_mesh(const Morph& morph, Bytes& bytes, Progress& progress) {
    const double t = bytes.share();
    if (morph.has_mesh())
        promise(morph.wrapped(t, progress).allFinite(), "a wrapped mesh is finite");
    if (morph.has_target_mesh())
        promise(morph.wrapped_target(t, progress).allFinite(), "a wrapped mesh is finite");
}

// --- Questions ---

void ask_for_options(Bytes& bytes) {
    MorphOptions options;
    const auto& table = option_table();
    for (Index number = 1 + bytes.below(8); number > 0; --number) {
        const Option& option = table[to_size(bytes.below(to_index(table.size())))];
        const OptionValue value = value_of(bytes, option, true);
        set_option(options, bytes.chance(8) ? name_of(bytes) : option.name, value);
        const OptionValue kept = option.get(options);
        const auto* number_kept = std::get_if<double>(&kept);
        promise(!number_kept || (*number_kept >= option.minimum && *number_kept <= option.maximum),
                "an option is in its range");
    }
}

void ask_for_checks(Bytes& bytes) {
    const Cloud source = cloud_of(bytes), target = cloud_of(bytes);
    const std::vector<Feature> features = features_of(bytes, source.size(), target.size());
    validate(source, bytes.below(12));
    validate(target, 0);
    for (const Cloud* cloud : {&source, &target}) {
        const Normalization unit = normalization(cloud->positions);
        promise(unit.scale > 0.0 && unit.apply(cloud->positions).allFinite(),
                "a valid cloud can be normalized");
        const std::vector<Index> order = spatial_order(cloud->positions);
        promise(std::ssize(inverse_order(order)) == cloud->size(), "an order has all rows");
        const Mesh mesh = make_mesh(*cloud);
        promise(mesh.positions.allFinite() && mesh.areas.allFinite(), "a mesh is finite");
    }
    validate(features, source, target);
    const std::vector<Index> one = spatial_order(source.positions),
                             two = spatial_order(target.positions);
    const auto sorted = canonical(features, inverse_order(one), inverse_order(two));
    promise(sorted.size() == features.size() &&
                pinned_pairs(sorted).size() == pinned_pairs(features).size(),
            "no feature gets lost");
}

void ask_for_saved(Bytes& bytes) {
    const MorphOptions options = options_of(bytes);
    KeptMorph kept;
    kept.source = cloud_of(bytes);
    kept.target = cloud_of(bytes);
    const std::uint8_t flags = bytes.byte();
    for (Cloud* cloud : {&kept.source, &kept.target}) {
        if (flags % 64 == 1) continue;
        if (cloud->normals.rows() == 0)
            cloud->normals = Normals::Constant(cloud->size(), 3, 1.0 / std::sqrt(3.0));
        if (cloud->radii.rows() == 0) cloud->radii = Values::Constant(cloud->size(), 0.1);
    }
    const Index source = kept.source.size(), target = kept.target.size();
    kept.pairs = pairs_of(bytes, source, target);
    if (flags & 64) kept.images = {places_of(bytes, source), places_of(bytes, target)};
    if (options.stagger.kind == StaggerKind::kDelay) kept.delays = values_of(bytes, source);
    const bool has_ends = flags & 128;  // else both meshes would be wrapped, which takes seconds
    if (has_ends) {
        kept.source_ends = shapes::cube_noise(source, bytes.byte());
        kept.target_ends = shapes::cube_noise(target, bytes.byte());
    }
    if (bytes.chance(128)) kept.resampling = plan_of(bytes, to_index(kept.pairs.size()));
    const auto morph = std::make_shared<const Morph>(std::move(kept), options);
    Progress progress;
    look_at_pairs(*morph);
    look_at_frames(*morph, bytes, progress);
    if (has_ends) look_at_mesh(*morph, bytes, progress);
    if (!bytes.chance(32)) return;
    const Morph chain({morph, morph}, options, {});
    look_at_frames(chain, bytes, progress);
}

void ask_for_transforms(Bytes& bytes) {
    const Cloud cloud = cloud_of(bytes);
    validate(cloud, 0);
    const Positions places = Normalization(normalization(cloud.positions)).apply(cloud.positions);
    Positions images = places_of(bytes, cloud.size());
    if (images.rows() != places.rows() || !images.allFinite()) images = places;
    images /= std::max(images.cwiseAbs().maxCoeff(), 1e-300);
    const Similarity fitted = fit_similarity(places, images);
    promise(fitted.rotation.allFinite() && std::abs(fitted.rotation.determinant() - 1.0) < 1e-6 &&
                fitted.scale >= 0.0 && fitted.translation.allFinite(),
            "a similarity turns and scales");
    const MorphOptions options = options_of(bytes);
    const Values when = delays(places, values_of(bytes, cloud.size()), options.stagger);
    for (Index i = 0; i < when.rows(); ++i) {
        const double time = local_time(bytes.share(), when[i], options.stagger);
        promise(when[i] >= 0.0 && when[i] <= 1.0 && time >= 0.0 && time <= 1.0,
                "times are from 0 to 1");
    }
    constexpr double kLeastScale = 1e-6, kStartError = 1e-6, kEndError = 1e-9;
    if (!(fitted.scale > kLeastScale)) return;
    const GradualSimilarity similarity{fitted, places.colwise().mean().transpose()};
    const Normals normals = Normals::Constant(places.rows(), 3, 1.0 / std::sqrt(3.0));
    Progress progress;
    const auto path = static_cast<PathKind>(bytes.below(3));
    const Motion motion(places, normals, images, similarity, path, progress);
    promise(motion.at(bytes.share()).positions.allFinite(), "a motion is finite");
    promise((motion.at(0.0).positions - places).cwiseAbs().maxCoeff() < kStartError &&
                (motion.at(1.0).positions - images).cwiseAbs().maxCoeff() < kEndError,
            "a motion is at its ends where it is told to be");
}

/// Asks for the end after so many reports, where that isn't 0.
class Impatient {
public:
    explicit Impatient(int reports)
        : left_(reports),
          progress_([this](std::string_view, double) { return left_ == 0 || --left_ > 0; },
                    std::chrono::milliseconds(0)) {}
    Progress& progress() { return progress_; }

private:
    int left_;
    Progress progress_;
};

void ask_for_morph(Bytes& bytes) {
    Impatient user(bytes.chance(32) ? bytes.byte() : 0);
    Progress& progress = user.progress();
    const MorphOptions options = options_of(bytes);
    const Morph morph(input_of(bytes), options, progress);
    look_at_pairs(morph);
    promise(morph.source_to_target(progress).allFinite() &&
                morph.target_to_source(progress).allFinite(),
            "maps are finite");
    look_at_frames(morph, bytes, progress);
    if (bytes.chance(64)) look_at_mesh(morph, bytes, progress);
    if (bytes.chance(64)) {
        const Quality& quality = morph.quality(progress);
        promise(std::isfinite(quality.source_to_target.stretch_p99), "quality is finite");
        const LocalConfidence& sure = morph.local_confidence(progress);
        promise(sure.source.allFinite() && sure.target.allFinite(), "confidence is finite");
    }
    if (bytes.chance(16)) {
        const Index source = morph.source().size(), target = morph.target().size();
        const Morph changed = morph.updated(features_of(bytes, source, target), progress);
        look_at_pairs(changed);
        look_at_frames(changed, bytes, progress);
    }
}

void ask_for_previews(Bytes& bytes) {
    Impatient user(bytes.chance(32) ? bytes.byte() : 0);
    const MorphOptions options = options_of(bytes);
    const MorphInput input = input_of(bytes);
    const Index kind = bytes.below(3);
    if (kind == 0) {
        const auto loop = suggest_loop(input, options, user.progress());
        promise(loop.size() >= 3, "a loop has three features");
    } else if (kind == 1) {
        const NamedNetwork found = preview_network(input, options, user.progress());
        for (const NetworkCurve& curve : found.network.curves)
            promise(curve.on[0].points.allFinite() && curve.on[1].points.allFinite(),
                    "curves are finite");
    } else {
        std::vector<Index> rows;
        std::vector<std::string> names;
        for (const Feature& feature : input.features) {
            if (feature.source.rows.empty()) continue;
            rows.push_back(feature.source.rows.front());
            names.push_back(feature.name);
        }
        const CutPreview cut = preview_cut(input.source, rows, names, options, user.progress());
        promise(cut.curve.points.allFinite(), "a curve is finite");
    }
}

}  // namespace

Answer try_bytes(std::span<const std::uint8_t> given) {
    Bytes bytes(given);
    const ThreadCount one(1);
    try {
        switch (static_cast<Question>(bytes.byte() % kQuestions)) {
            case Question::kOptions:
                ask_for_options(bytes);
                break;
            case Question::kShapes:
                ask_for_checks(bytes);
                break;
            case Question::kSaved:
                ask_for_saved(bytes);
                break;
            case Question::kTransforms:
                ask_for_transforms(bytes);
                break;
            case Question::kMorph:
                ask_for_morph(bytes);
                break;
            case Question::kPreviews:
                ask_for_previews(bytes);
                break;
        }
    } catch (const Error&) {
        return Answer::kRefused;
    } catch (const Cancelled&) {
        return Answer::kRefused;
    }
    return Answer::kDone;
}

}  // namespace pointmorph::fuzzing

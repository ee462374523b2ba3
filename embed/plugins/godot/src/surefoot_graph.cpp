#include "surefoot_graph.hpp"

#include "frames.hpp"
#include "names.hpp"

#include <cstring>

namespace surefoot {

using engine::Array;
using engine::Dictionary;
using engine::PackedVector3Array;
using engine::push_error;
using engine::Variant;

namespace {

const char* name_of_no_path(sf_no_path reason) {
    switch (reason) {
        case SF_PATH_FOUND: return "";
        case SF_START_OFF_GRAPH: return "start_off_graph";
        case SF_GOAL_OFF_GRAPH: return "goal_off_graph";
        case SF_DIFFERENT_ISLANDS: return "different_islands";
        case SF_ONE_WAY: return "one_way";
        case SF_GOAL_IN_ZONE: return "goal_in_zone";
        default: return "unknown";
    }
}

// A vertex as scripts see it: -1 for an end of a plan that is no vertex.
int64_t vertex_of(uint32_t stop) { return stop == SF_STOP_START || stop == SF_STOP_GOAL ? -1 : static_cast<int64_t>(stop); }

// Reports what a call says, with the name of the function that scripts know.
bool succeeded(sf_status status, const sf_error& error, const char* where) {
    if (status == SF_OK) {
        return true;
    }
    push_error(std::string(where) + ": " + error.message);
    return false;
}

// Numbers of vertices come from scripts as any integer.
bool are_vertices(int64_t from, int64_t to, const char* where) {
    if (from >= 0 && to >= 0 && from < SF_STOP_GOAL && to < SF_STOP_GOAL) {
        return true;
    }
    push_error(std::string(where) + ": vertices are numbered from 0 on, but the edge is given as " + std::to_string(from) + " to " +
               std::to_string(to) + "; take numbers from get_edges()");
    return false;
}

}  // namespace

bool read_file(const std::string& what, const std::string& path, std::vector<uint8_t>& bytes) {
    const Variant class_db = Variant::singleton("ClassDB");
    if (!class_db.call("class_call_static", "FileAccess", "file_exists", path).boolean()) {
        push_error(what + ": there is no file '" + path + "'; check the path, and in an exported game the filter of files that are exported");
        return false;
    }
    bytes = class_db.call("class_call_static", "FileAccess", "get_file_as_bytes", path).bytes();
    if (bytes.empty()) {
        push_error(what + ": the file '" + path + "' is empty or cannot be read");
        return false;
    }
    return true;
}

SurefootGraph::~SurefootGraph() {
    forget_rehearsals();
    sf_graph_destroy(graph_);
}

void SurefootGraph::set_file(const std::string& file) {
    if (file != file_) {
        sf_graph_destroy(graph_);
        graph_ = nullptr;
        is_unreadable_ = false;
        file_ = file;
    }
}

bool SurefootGraph::load() {
    if (graph_ != nullptr || is_unreadable_) {
        return graph_ != nullptr;
    }
    is_unreadable_ = true;
    if (file_.empty()) {
        push_error("SurefootGraph.file is empty: set it to a file that `surefoot graph export LEVEL --format json --out FILE` wrote");
        return false;
    }
    std::vector<uint8_t> bytes;
    sf_error error;
    if (read_file("SurefootGraph.file", file_, bytes) &&
        succeeded(sf_graph_load_memory(bytes.data(), bytes.size(), &graph_, &error), error, ("SurefootGraph.file '" + file_ + "'").c_str())) {
        is_unreadable_ = false;
    }
    return graph_ != nullptr;
}

void SurefootGraph::set_level(const std::string& level) {
    if (level != level_) {
        forget_rehearsals();
        is_level_unreadable_ = false;
        level_ = level;
    }
}

void SurefootGraph::forget_rehearsals() {
    for (const Stage& stage : stages_) {
        sf_rehearsals_destroy(stage.rehearsals);
    }
    stages_.clear();
}

sf_map* read_level(const std::string& what, const std::string& path) {
    std::vector<uint8_t> bytes;
    sf_error error;
    sf_map* map = nullptr;
    if (read_file(what, path, bytes)) {
        succeeded(sf_map_load_memory(bytes.data(), bytes.size(), &map, &error), error, (what + " '" + path + "'").c_str());
    }
    return map;
}

bool read_origin(const std::string& what, const std::string& path, sf_vec3& origin) {
    sf_map* map = read_level(what, path);
    sf_vec3 extent;
    sf_error error;
    const bool is_known =
        map != nullptr && succeeded(sf_map_extent(map, &extent, &origin, &error), error, what.c_str());
    sf_map_destroy(map);
    return is_known;
}

bool SurefootGraph::align_to(const std::string& level) {
    if (!read_origin("SurefootGraph.align_to", level, origin_)) {
        return false;
    }
    set_level(level);
    return true;
}

sf_rehearsals* SurefootGraph::rehearsals_of(const sf_policy* policy, const sf_body& body) {
    char label[64];
    size_t length = 0;
    if (level_.empty() || is_level_unreadable_ || sf_policy_label(policy, label, sizeof label, &length, nullptr) != SF_OK) {
        return nullptr;
    }
    for (const Stage& stage : stages_) {
        if (stage.policy == label && std::memcmp(&stage.body, &body, sizeof body) == 0) {
            return stage.rehearsals;
        }
    }
    sf_map* map = read_level("SurefootGraph.level", level_);
    sf_rehearsals* rehearsals = nullptr;
    sf_error error;
    is_level_unreadable_ =
        map == nullptr || !succeeded(sf_rehearsals_create(policy, map, &body, 1, &rehearsals, &error), error, "SurefootGraph.level");
    sf_map_destroy(map);
    if (rehearsals != nullptr) {
        stages_.push_back({label, body, rehearsals});
        place_blocks(blocks_, rehearsals);
    }
    return rehearsals;
}

bool SurefootGraph::set_blocks(const Array& nodes) {
    if (level_.empty()) {
        push_error("SurefootGraph.set_blocks: there is no level, so that no agent rehearses: set `level`, or call align_to, first");
        return false;
    }
    std::vector<SceneBlock> blocks;
    if (!read_blocks("SurefootGraph.set_blocks", nodes, blocks)) {
        return false;
    }
    for (const Stage& stage : stages_) {
        if (!place_blocks(blocks, stage.rehearsals)) {
            return false;
        }
    }
    blocks_ = std::move(blocks);
    return true;
}

// Puts blocks into the level of rehearsals. An error names the node.
bool SurefootGraph::place_blocks(const std::vector<SceneBlock>& blocks, const sf_rehearsals* rehearsals) const {
    std::vector<sf_block> on_map;
    for (const SceneBlock& it : blocks) {
        on_map.push_back(it.block);
        on_map.back().foot = to_map(it.block.foot);
    }
    sf_error error;
    if (sf_rehearsals_set_blocks(rehearsals, on_map.data(), on_map.size(), &error) == SF_OK) {
        return true;
    }
    std::string message = error.message;
    for (size_t idx = 0; idx < blocks.size(); idx++) {
        const std::string name = "blocks[" + std::to_string(idx) + "]";
        if (const size_t at = message.find(name); at != std::string::npos) {
            message.replace(at, name.size(), blocks[idx].label);
        }
    }
    push_error("SurefootGraph.set_blocks: " + message);
    return false;
}

sf_vec3 SurefootGraph::to_map(sf_vec3 place) const { return frames::plus(place, origin_); }

sf_vec3 SurefootGraph::from_map(sf_vec3 place) const { return frames::minus(place, origin_); }

Dictionary SurefootGraph::describe(const sf_leg& leg) const {
    Dictionary described;
    described.set("waypoint", from_map(leg.waypoint));
    described.set("from", vertex_of(leg.key.from));
    described.set("to", vertex_of(leg.key.to));
    described.set("ability", name_of(leg.ability, graph_).c_str());
    described.set("seconds", static_cast<double>(leg.seconds));
    described.set("chance", static_cast<double>(leg.chance));
    described.set("death_chance", static_cast<double>(leg.death_chance));
    return described;
}

Dictionary SurefootGraph::find_path(sf_vec3 start, sf_vec3 goal, double caution, int64_t without) {
    Dictionary found;
    if (!load()) {
        return found;
    }
    sf_query query{};
    query.struct_size = sizeof query;
    query.without = static_cast<uint32_t>(without);
    query.start = to_map(start);
    query.goal = to_map(goal);
    query.caution = static_cast<float>(caution);
    std::vector<sf_leg> legs(32);
    size_t leg_count = 0;
    sf_plan plan;
    sf_error error;
    sf_status status = sf_graph_find_path(graph_, &query, legs.data(), legs.size(), &leg_count, &plan, &error);
    if (status == SF_BUFFER_TOO_SMALL) {
        legs.resize(leg_count);
        status = sf_graph_find_path(graph_, &query, legs.data(), legs.size(), &leg_count, &plan, &error);
    }
    if (!succeeded(status, error, "SurefootGraph.find_path")) {
        return found;
    }
    Array described;
    for (size_t idx = 0; idx < leg_count; idx++) {
        described.call("append", describe(legs[idx]));
    }
    found.set("found", plan.no_path == SF_PATH_FOUND);
    found.set("reason", name_of_no_path(plan.no_path));
    found.set("leads_near", plan.leads_near != 0);
    found.set("seconds", static_cast<double>(plan.seconds));
    found.set("arrival_chance", static_cast<double>(plan.arrival_chance));
    found.set("death_chance", static_cast<double>(plan.death_chance));
    found.set("legs", described);
    return found;
}

bool SurefootGraph::set_edge_open(int64_t from, int64_t to, bool is_open) {
    constexpr const char* where = "SurefootGraph.set_edge_open";
    sf_error error;
    return load() && are_vertices(from, to, where) &&
           succeeded(sf_graph_set_edge_open(graph_, static_cast<uint32_t>(from), static_cast<uint32_t>(to), is_open, &error), error, where);
}

bool SurefootGraph::set_edge_price(int64_t from, int64_t to, double factor) {
    constexpr const char* where = "SurefootGraph.set_edge_price";
    sf_error error;
    return load() && are_vertices(from, to, where) &&
           succeeded(sf_graph_set_edge_price(graph_, static_cast<uint32_t>(from), static_cast<uint32_t>(to), static_cast<float>(factor), &error), error, where);
}

std::vector<sf_vec3> SurefootGraph::vertices() {
    sf_graph_info info{};
    info.struct_size = sizeof info;
    sf_error error;
    if (!load() || !succeeded(sf_graph_describe(graph_, &info, &error), error, "SurefootGraph.get_vertices")) {
        return {};
    }
    std::vector<sf_vec3> places(info.vertex_count);
    size_t count = 0;
    const bool are_known = succeeded(sf_graph_vertices(graph_, places.data(), places.size(), &count, &error), error, "SurefootGraph.get_vertices");
    return are_known ? places : std::vector<sf_vec3>();
}

PackedVector3Array SurefootGraph::get_vertices() {
    PackedVector3Array places;
    for (const sf_vec3& vertex : vertices()) {
        places.call("append", from_map(vertex));
    }
    return places;
}

Array SurefootGraph::get_edges() {
    Array described;
    sf_graph_info info{};
    info.struct_size = sizeof info;
    sf_error error;
    if (!load() || !succeeded(sf_graph_describe(graph_, &info, &error), error, "SurefootGraph.get_edges")) {
        return described;
    }
    const std::vector<sf_vec3> places = vertices();
    std::vector<sf_edge> edges(info.edge_count);
    size_t count = 0;
    if (!succeeded(sf_graph_edges(graph_, edges.data(), edges.size(), &count, &error), error, "SurefootGraph.get_edges")) {
        return described;
    }
    for (const sf_edge& edge : edges) {
        const sf_leg leg{places.at(edge.key.to), edge.key, edge.ability, edge.seconds, edge.chance, edge.death_chance};
        Dictionary one = describe(leg);
        one.set("start", from_map(places.at(edge.key.from)));
        one.set("is_open", edge.is_open != 0);
        described.call("append", one);
    }
    return described;
}

void SurefootGraph::register_class() {
    using engine::ClassBuilder;
    using G = SurefootGraph;
    constexpr uint32_t hint_file = 13;
    ClassBuilder("SurefootGraph", "Resource", false, []() -> std::unique_ptr<engine::Instance> { return std::make_unique<G>(); })
        .property<&G::get_file, &G::set_file>({"file", GDEXTENSION_VARIANT_TYPE_STRING, hint_file, "*.json", ""})
        .property<&G::get_level, &G::set_level>({"level", GDEXTENSION_VARIANT_TYPE_STRING, hint_file, "*.sfmap,*.glb,*.gltf,*.obj", ""})
        .property<&G::get_origin, &G::set_origin>({"origin", GDEXTENSION_VARIANT_TYPE_VECTOR3, 0, "", ""})
        .method<&G::load>("load")
        .method<&G::align_to>("align_to", {"level"})
        .method<&G::find_path>("find_path", {"start", "goal", "caution", "without"}, {Variant(1.0), Variant(int64_t{0})})
        .method<&G::set_edge_open>("set_edge_open", {"from", "to", "is_open"})
        .method<&G::set_edge_price>("set_edge_price", {"from", "to", "factor"})
        .method<&G::set_blocks>("set_blocks", {"nodes"})
        .method<&G::get_vertices>("get_vertices")
        .method<&G::get_edges>("get_edges");
}

}  // namespace surefoot

// The resource SurefootGraph: a proved graph of a level, its plans, and its edges, which open and close.
#pragma once

#include "blocks.hpp"
#include "engine.hpp"

namespace surefoot {

class SurefootGraph final : public engine::Instance {
public:
    static void register_class();
    ~SurefootGraph() override;

    std::string get_file() const { return file_; }
    // Forgets the graph of another file; the new one is loaded when it is first used.
    void set_file(const std::string& file);
    std::string get_level() const { return level_; }
    // The level that the graph was proved on. With one, agents rehearse; empty: they do not.
    void set_level(const std::string& level);
    sf_vec3 get_origin() const { return origin_; }
    void set_origin(sf_vec3 origin) { origin_ = origin; }

    // Reads the file, unless that has been done. False, and an error in the log, if it cannot be read.
    bool load();
    // Sets `level` and `origin` from the level that the graph was proved on: .sfmap, .glb, .gltf or .obj.
    bool align_to(const std::string& level);
    engine::Dictionary find_path(sf_vec3 start, sf_vec3 goal, double caution, int64_t without);
    bool set_edge_open(int64_t from, int64_t to, bool is_open);
    bool set_edge_price(int64_t from, int64_t to, double factor);
    // Tells rehearsals which nodes stand in the level now, beside what its file has. False, and an error, if one of them
    // is no block; all then stay as they were.
    bool set_blocks(const engine::Array& nodes);
    engine::PackedVector3Array get_vertices();
    engine::Array get_edges();

    // For agents: the graph, null if it cannot be read, and places of the scene on its map.
    sf_graph* loaded() { return load() ? graph_ : nullptr; }
    // Rehearsals for agents with this policy and body; null without a level, or if it cannot be read.
    sf_rehearsals* rehearsals_of(const sf_policy* policy, const sf_body& body);
    sf_vec3 to_map(sf_vec3 place) const;
    sf_vec3 from_map(sf_vec3 place) const;

    // A leg as scripts see it.
    engine::Dictionary describe(const sf_leg& leg) const;

private:
    // Rehearsals, and for which policy and body they are.
    struct Stage {
        std::string policy;
        sf_body body;
        sf_rehearsals* rehearsals;
    };

    std::vector<sf_vec3> vertices();
    bool place_blocks(const std::vector<SceneBlock>& blocks, const sf_rehearsals* rehearsals) const;
    void forget_rehearsals();

    std::string file_, level_;
    std::vector<Stage> stages_;
    std::vector<SceneBlock> blocks_;
    // Whether reading the level failed, which is said once.
    bool is_level_unreadable_ = false;
    sf_vec3 origin_{};
    sf_graph* graph_ = nullptr;
    // Whether reading the file failed, which is said once.
    bool is_unreadable_ = false;
};

// Contents of a file of the project, or elsewhere. False, and an error that begins with `what`, if it cannot be read.
bool read_file(const std::string& what, const std::string& path, std::vector<uint8_t>& bytes);

// The level in a file as a map. Null, and an error that begins with `what`, if it cannot be read.
sf_map* read_level(const std::string& what, const std::string& path);

// The place of a level's origin on its map, m. False, and an error that begins with `what`, if it cannot be read.
bool read_origin(const std::string& what, const std::string& path, sf_vec3& origin);

}  // namespace surefoot

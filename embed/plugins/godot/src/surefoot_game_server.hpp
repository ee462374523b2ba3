// The node SurefootGameServer: serves the scene as a world, so that Surefoot proves graphs, fits bodies and measures
// success in Godot's physics, with the game's own characters.
#pragma once

#include "engine.hpp"

struct sfg_body;
struct sfg_server;

namespace surefoot {

class SurefootGameServer final : public engine::Instance {
public:
    static void register_class();
    ~SurefootGameServer() override;
    void notified(int32_t what) override;

    std::string get_address() const { return address_; }
    void set_address(const std::string& address) { address_ = address; }
    engine::Variant get_character() const { return character_; }
    void set_character(const engine::Variant& character) { character_ = character; }
    std::string get_level() const { return level_; }
    void set_level(const std::string& level) { level_ = level; }
    // The port that is bound; 0 while the node does not listen.
    int64_t get_port() const;

private:
    // The callbacks of the protocol.
    struct Calls;
    struct World;

    void begin();
    void serve();
    // Adds a character to a world. False, and a line in `refusal`, if there is none of this size.
    bool add_character(World& world, const sfg_body& size, std::string& refusal);

    std::string address_ = "tcp://127.0.0.1:7701";
    engine::Variant character_;
    std::string level_;

    // The origin of the scene on Surefoot's map, m.
    sf_vec3 origin_{};
    // A world was opened in this frame. Its characters move from the next one on.
    bool has_opened_ = false;
    // Whether anything in the scene burns.
    bool has_lava_ = false;
    sfg_server* server_ = nullptr;
    // What went wrong last, to say it once.
    std::string error_;
};

}  // namespace surefoot

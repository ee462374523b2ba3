#define SFG_IMPLEMENTATION
#include "surefoot_game.h"

#include "frames.hpp"
#include "surefoot_agent_3d.hpp"
#include "surefoot_game_server.hpp"
#include "surefoot_graph.hpp"

#include <chrono>
#include <memory>

namespace surefoot {

using engine::push_error;
using engine::Variant;

namespace {

constexpr const char* lava = "surefoot_lava";
// Distance below the level at which a character has fallen out of it, m.
constexpr float fall_m = 5.0f;
// Difference in size that the rounding of files explains, m.
constexpr float size_m = 0.01f;
// Longest that a frame serves, so that the window keeps reacting, and longest wait for a client between two messages.
constexpr std::chrono::milliseconds longest_frame{100};
constexpr int wait_ms = 5;

uint8_t surface_of(sf_surface surface) {
    // What games call ground includes ladders.
    return static_cast<uint8_t>(surface == SF_SURFACE_CLIMB ? 0 : surface - SF_SURFACE_GROUND);
}

bool differs(float asked, float found) { return std::fabs(asked - found) > size_m; }

std::string in_metres(float value) {
    char text[32];
    std::snprintf(text, sizeof text, "%.2f m", static_cast<double>(value));
    return text;
}

sf_vec3 from_protocol(sfg_vec3 it) { return {it.x, it.y, it.z}; }
sfg_vec3 to_protocol(sf_vec3 it) { return {it.x, it.y, it.z}; }

// The agent that is a child of a node; null without one.
SurefootAgent3D* agent_below(const Variant& node) {
    const Variant agents = node.call("find_children", "*", "SurefootAgent3D", false, false);
    return dynamic_cast<SurefootAgent3D*>(engine::Instance::of(agents.at(int64_t{0})));
}

}  // namespace

// One connection's characters.
struct SurefootGameServer::World {
    struct Character {
        Variant node;
        SurefootAgent3D* agent;
        uint32_t flags = 0;
    };

    explicit World(SurefootGameServer& server) : server(server) {}
    World(const World&) = delete;
    World& operator=(const World&) = delete;
    ~World() {
        for (const Character& character : characters) {
            character.node.call("queue_free");
        }
    }

    SurefootGameServer& server;
    std::vector<Character> characters;
};

struct SurefootGameServer::Calls {
    static void* open(void* user, const sfg_body* body, uint32_t count, char refusal[SFG_REFUSAL_BYTES]) {
        auto& server = *static_cast<SurefootGameServer*>(user);
        auto world = std::make_unique<World>(server);
        for (uint32_t idx = 0; idx < count; idx++) {
            std::string reason;
            if (!server.add_character(*world, *body, reason)) {
                std::snprintf(refusal, SFG_REFUSAL_BYTES, "%s", reason.c_str());
                return nullptr;
            }
        }
        server.has_opened_ = true;
        return world.release();
    }

    static void close(void* world) { delete static_cast<World*>(world); }

    static void place(void* world, uint32_t idx, sfg_vec3 feet, float yaw) {
        World& of = *static_cast<World*>(world);
        World::Character& character = of.characters[idx];
        character.agent->place(frames::minus(from_protocol(feet), of.server.origin_), yaw);
        character.flags = 0;
    }

    static void tick(void* world, const sfg_command* commands, uint32_t count) {
        World& of = *static_cast<World*>(world);
        for (const sfg_command* it = commands; it < commands + count; it++) {
            World::Character& character = of.characters[it->character];
            if (it->is_first) {
                character.agent->act({it->action.forward, it->action.strafe, it->action.turn, it->action.jump});
            }
            const sf_ability used = character.agent->step(SFG_TICK_SECONDS);
            character.flags = used == SF_JUMP ? SFG_JUMPED : used == SF_DOUBLE_JUMP ? SFG_DOUBLE_JUMPED : 0;
            if (character.agent->feet().y + of.server.origin_.y < -fall_m) {
                character.flags |= SFG_FELL;
            } else if (of.server.has_lava_ && character.agent->touches(lava)) {
                character.flags |= SFG_BURNT;
            }
        }
    }

    static void state(void* world, uint32_t idx, sfg_state* state) {
        World& of = *static_cast<World*>(world);
        const World::Character& character = of.characters[idx];
        const sf_state now = character.agent->state();
        state->feet = to_protocol(frames::plus(now.feet, of.server.origin_));
        state->velocity = to_protocol(now.velocity);
        state->yaw = now.yaw;
        // From the ground, a jump is always made.
        const uint32_t grounded = (now.flags & SF_GROUNDED) != 0 ? SFG_GROUNDED | SFG_CAN_JUMP : 0;
        const uint32_t can_jump = (now.flags & SF_CAN_JUMP) != 0 ? SFG_CAN_JUMP : 0;
        state->flags = character.flags | grounded | can_jump;
    }

    static void cast(void* world, sfg_vec3 from, const sfg_vec3 directions[SFG_RAYS], float range, sfg_hit hits[SFG_RAYS]) {
        World& of = *static_cast<World*>(world);
        const sf_vec3 origin = frames::minus(from_protocol(from), of.server.origin_);
        sf_ray rays[SFG_RAYS]{};
        sf_hit found[SFG_RAYS]{};
        for (int idx = 0; idx < SFG_RAYS; idx++) {
            rays[idx].origin = origin;
            rays[idx].direction = from_protocol(directions[idx]);
        }
        of.characters.front().agent->cast(rays, SFG_RAYS, found);
        for (int idx = 0; idx < SFG_RAYS; idx++) {
            if (found[idx].surface != SF_SURFACE_NONE && found[idx].distance <= range) {
                hits[idx] = {found[idx].distance, surface_of(found[idx].surface)};
            }
        }
    }
};

void SurefootGameServer::register_class() {
    using S = SurefootGameServer;
    constexpr uint32_t hint_file = 13, hint_resource = 17;
    engine::ClassBuilder("SurefootGameServer", "Node", true,
                         []() -> std::unique_ptr<engine::Instance> { return std::make_unique<S>(); })
        .method<&S::get_port>("get_port")
        .property<&S::get_address, &S::set_address>({"address", GDEXTENSION_VARIANT_TYPE_STRING, 0, "", ""})
        .property<&S::get_character, &S::set_character>(
            {"character", GDEXTENSION_VARIANT_TYPE_OBJECT, hint_resource, "PackedScene", "PackedScene"})
        .property<&S::get_level, &S::set_level>({"level", GDEXTENSION_VARIANT_TYPE_STRING, hint_file, "*.glb,*.gltf,*.obj,*.sfmap", ""});
}

SurefootGameServer::~SurefootGameServer() { sfg_free(server_); }

int64_t SurefootGameServer::get_port() const { return server_ == nullptr ? 0 : sfg_port(server_); }

void SurefootGameServer::notified(int32_t what) {
    if (what == engine::NOTIFICATION_READY) {
        begin();
    } else if (what == engine::NOTIFICATION_EXIT_TREE) {
        sfg_free(std::exchange(server_, nullptr));
        self().call("request_ready");
    } else if (what == engine::NOTIFICATION_INTERNAL_PHYSICS_PROCESS && server_ != nullptr) {
        serve();
    }
}

void SurefootGameServer::begin() {
    if (character_.object() == nullptr || !character_.call("can_instantiate").boolean()) {
        push_error("SurefootGameServer.character is no scene: set it to the scene of your character, with a SurefootAgent3D");
        return;
    }
    if (Variant::singleton("Engine").call("get_physics_ticks_per_second").integer() != SF_TICKS_PER_SECOND) {
        push_error("SurefootGameServer: set physics/common/physics_ticks_per_second to 60, the rate of the protocol");
        return;
    }
    if (!read_origin("SurefootGameServer.level", level_, origin_)) {
        return;
    }
    const Variant burning = self().call("get_tree").call("get_nodes_in_group", lava);
    has_lava_ = burning.call("size").integer() > 0;
    sfg_game game{};
    game.user = this;
    game.open = Calls::open;
    game.close = Calls::close;
    game.place = Calls::place;
    game.tick = Calls::tick;
    game.state = Calls::state;
    game.cast = Calls::cast;
    char error[SFG_REFUSAL_BYTES];
    server_ = sfg_listen(address_.c_str(), &game, error);
    if (server_ == nullptr) {
        push_error("SurefootGameServer.address '" + address_ + "': " + error);
        return;
    }
    self().call("set_physics_process_internal", true);
}

// Answers all that clients ask within a frame. A client asks again as soon as it has its answer.
void SurefootGameServer::serve() {
    const auto end = std::chrono::steady_clock::now() + longest_frame;
    has_opened_ = false;
    bool is_asked = true;
    while (is_asked && !has_opened_ && std::chrono::steady_clock::now() < end) {
        is_asked = sfg_poll(server_, sfg_worlds(server_) > 0 ? wait_ms : 0) > 0;
    }
    if (error_ != sfg_error(server_)) {
        error_ = sfg_error(server_);
        push_error("SurefootGameServer: " + error_);
    }
}

bool SurefootGameServer::add_character(World& world, const sfg_body& size, std::string& refusal) {
    const Variant node = character_.call("instantiate");
    SurefootAgent3D* agent = agent_below(node);
    if (agent == nullptr) {
        refusal = "the scene of the character has no SurefootAgent3D: add one below its root";
        node.call("free");
        return false;
    }
    self().call("add_child", node);
    world.characters.push_back({node, agent});
    if (!agent->be_driven()) {
        refusal = "the SurefootAgent3D of the character is not ready: see the log of Godot";
        return false;
    }
    const sf_body& own = agent->profile();
    if (differs(size.height, own.height) || differs(size.radius, own.radius)) {
        refusal = "the character is " + in_metres(own.height) + " high with a radius of " + in_metres(own.radius) +
                  ", not " + in_metres(size.height) + " and " + in_metres(size.radius) + ": pass its size with --body";
        return false;
    }
    // Characters are not in each other's way.
    node.call("set_collision_layer", static_cast<int64_t>(0));
    return true;
}

}  // namespace surefoot

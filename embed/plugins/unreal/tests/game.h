// A stand-in for a level in Unreal: the simulation of libsurefoot, seen in centimetres and degrees on Unreal's axes.
#pragma once

#include "expect.h"

#include <vector>

class Game : public surefoot::RayBatch {
public:
    Game(const std::string& level, const surefoot::LevelFrame& frame) : frame_(frame) {
        sf_error error;
        must(sf_map_load(level.c_str(), &map_, &error), error);
        must(sf_world_create(map_, nullptr, &world_, &error), error);
    }
    ~Game() override {
        sf_world_destroy(world_);
        sf_map_destroy(map_);
    }
    Game(const Game&) = delete;
    Game& operator=(const Game&) = delete;

    std::uint32_t spawn(const surefoot::Vector& feet, double yaw_degrees) {
        sf_error error;
        std::uint32_t npc = 0;
        must(sf_world_spawn(world_, frame_.to_map(feet), surefoot::LevelFrame::to_map_yaw(yaw_degrees), &npc, &error), error);
        return npc;
    }

    surefoot::Character character(std::uint32_t npc) const {
        sf_error error;
        sf_state state{};
        state.struct_size = sizeof state;
        must(sf_world_state(world_, npc, &state, &error), error);
        const bool is_grounded = (state.flags & SF_GROUNDED) != 0;
        return {frame_.from_map(state.feet), surefoot::LevelFrame::from_map_velocity(state.velocity),
                surefoot::LevelFrame::from_map_yaw(state.yaw), is_grounded, (state.flags & (SF_GROUNDED | SF_CAN_JUMP)) != 0};
    }

    void decide(std::uint32_t npc, const surefoot::Controls& controls) {
        sf_error error;
        const sf_action action{float(controls.forward), float(controls.right), float(-controls.turn), controls.jump ? 1.0f : -1.0f};
        must(sf_world_decide(world_, npc, action, &error), error);
        jumps += controls.jump;
    }

    // Decisions with a jump.
    int jumps = 0;


    void tick() {
        sf_error error;
        must(sf_world_tick(world_, nullptr, &error), error);
    }

    // The devices of the level, as a game would know them.
    std::vector<surefoot::Device> devices() const {
        std::size_t count = 0;
        sf_map_devices(map_, nullptr, 0, &count, nullptr);
        std::vector<sf_device> natives(count);
        sf_error error;
        must(sf_map_devices(map_, natives.data(), count, &count, &error), error);
        std::vector<surefoot::Device> devices;
        for (const sf_device& native : natives) {
            devices.push_back({native.kind, native.two_way != 0, frame_.from_map(native.from), frame_.from_map(native.to)});
        }
        return devices;
    }

    void trace(const surefoot::Segment* segments, std::size_t count, surefoot::SegmentHit* hits) override {
        // Room that is kept, so that the test of allocations sees only the adapter's.
        rays_.resize(count);
        found_.resize(count);
        for (std::size_t idx = 0; idx < count; idx++) {
            const surefoot::Segment& segment = segments[idx];
            const double length = surefoot::distance(segment.start, segment.end);
            expect_near(length, SF_RAY_RANGE * 100.0, 1.0, "the length of a segment");
            const surefoot::Vector direction{(segment.end.x - segment.start.x) / length * 100.0, (segment.end.y - segment.start.y) / length * 100.0,
                                             (segment.end.z - segment.start.z) / length * 100.0};
            rays_[idx] = {frame_.to_map(segment.start), surefoot::LevelFrame::to_map_velocity(direction)};
        }
        sf_error error;
        must(sf_world_cast_rays(world_, rays_.data(), count, found_.data(), &error), error);
        for (std::size_t idx = 0; idx < count; idx++) {
            hits[idx] = {found_[idx].distance * 100.0, found_[idx].surface};
        }
    }

private:
    surefoot::LevelFrame frame_;
    sf_map* map_ = nullptr;
    sf_world* world_ = nullptr;
    std::vector<sf_ray> rays_;
    std::vector<sf_hit> found_;
};

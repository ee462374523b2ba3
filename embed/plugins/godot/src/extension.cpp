// The entry of the extension, which Godot finds by the name in surefoot.gdextension.
#include "surefoot_agent_3d.hpp"
#include "surefoot_game_server.hpp"
#include "surefoot_graph.hpp"

namespace {

void initialize(void*, GDExtensionInitializationLevel level) {
    if (level == GDEXTENSION_INITIALIZATION_SCENE) {
        surefoot::SurefootGraph::register_class();
        surefoot::SurefootAgent3D::register_class();
        surefoot::SurefootGameServer::register_class();
    }
}

void deinitialize(void*, GDExtensionInitializationLevel level) {
    if (level == GDEXTENSION_INITIALIZATION_SCENE) {
        engine::unregister_class("SurefootGameServer");
        engine::unregister_class("SurefootAgent3D");
        engine::unregister_class("SurefootGraph");
    }
}

}  // namespace

extern "C" __attribute__((visibility("default"))) GDExtensionBool surefoot_init(GDExtensionInterfaceGetProcAddress find, GDExtensionClassLibraryPtr library,
                                                                                  GDExtensionInitialization* initialization) {
    if (sf_abi_version() != SF_ABI_VERSION) {
        return false;
    }
    engine::connect(find, library);
    initialization->minimum_initialization_level = GDEXTENSION_INITIALIZATION_SCENE;
    initialization->initialize = initialize;
    initialization->deinitialize = deinitialize;
    return true;
}

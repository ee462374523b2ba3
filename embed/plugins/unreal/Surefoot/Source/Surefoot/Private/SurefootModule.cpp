#include "HAL/PlatformProcess.h"
#include "Interfaces/IPluginManager.h"
#include "Misc/Paths.h"
#include "Modules/ModuleManager.h"
#include "SurefootConvert.h"
#include "SurefootLog.h"

DEFINE_LOG_CATEGORY(LogSurefoot);

bool LogSurefootError(const surefoot::Error& Error, const FString& Where)
{
    if (Error.is_set())
    {
        UE_LOG(LogSurefoot, Error, TEXT("%s: %s"), *Where, *ToUnreal(Error.text));
    }
    return !Error.is_set();
}

namespace
{
/** Windows does not search plugins' folders for libraries, so the module loads its own before anyone calls it. */
class FSurefootModule : public IModuleInterface
{
public:
    virtual void StartupModule() override
    {
#if PLATFORM_WINDOWS
        const FString Plugin = IPluginManager::Get().FindPlugin(TEXT("Surefoot"))->GetBaseDir();
        const FString Library = FPaths::Combine(Plugin, TEXT("Source/ThirdParty/libsurefoot/lib/surefoot.dll"));
        Handle = FPlatformProcess::GetDllHandle(*Library);
        if (!Handle)
        {
            UE_LOG(LogSurefoot, Error, TEXT("%s cannot be loaded: copy the library there"), *Library);
        }
#endif
    }

    virtual void ShutdownModule() override
    {
        if (Handle)
        {
            FPlatformProcess::FreeDllHandle(Handle);
        }
    }

private:
    void* Handle = nullptr;
};
}

IMPLEMENT_MODULE(FSurefootModule, Surefoot)

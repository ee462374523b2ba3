#pragma once

#include "CoreMinimal.h"
#include "SurefootAdapter.h"

DECLARE_LOG_CATEGORY_EXTERN(LogSurefoot, Log, All);

// Writes an error, if there is one, to the log. Returns whether all is well.
bool LogSurefootError(const surefoot::Error& Error, const FString& Where);

// The same numbers in the types of engine and adapter.
#pragma once

#include "CoreMinimal.h"
#include "SurefootAdapter.h"

inline surefoot::Vector ToSurefoot(const FVector& Vector)
{
    return {Vector.X, Vector.Y, Vector.Z};
}

inline FVector ToUnreal(const surefoot::Vector& Vector)
{
    return FVector(Vector.x, Vector.y, Vector.z);
}

inline FString ToUnreal(const std::string& Text)
{
    return FString(UTF8_TO_TCHAR(Text.c_str()));
}

inline std::string ToSurefoot(const FString& Text)
{
    return std::string(TCHAR_TO_UTF8(*Text));
}

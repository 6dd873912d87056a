/* Test vectors of `refsim contract --export`, read in C++11 without any library, on little-endian machines.
 *
 *   refsim::Vectors file("vectors/sph.density/variant_0_float32.npz");
 *   for (const refsim::Case &c : file.cases()) { ... c.get<float>("position") ... c.compare("density", mine) ... }
 */
#ifndef REFSIM_VECTORS_H
#define REFSIM_VECTORS_H

#include <cmath>
#include <cstdint>
#include <cstring>
#include <fstream>
#include <iterator>
#include <limits>
#include <map>
#include <memory>
#include <stdexcept>
#include <string>
#include <vector>

namespace refsim {

/* An answer beside the right one: its largest error over the bound, in which row, and how many rows were compared. */
struct Worst {
    double error;
    long row, rows;
    bool holds() const { return error <= 1; }
};

/* One array of a file: its numbers in C order as `count` of type `kind` and `width` bytes. */
struct Entry {
    const char *data;
    char kind; /* f, i, u or b */
    int width;
    std::vector<long> shape;
    long count() const
    {
        long product = 1;
        for (long size : shape)
            product *= size;
        return product;
    }
    template <class T> T at(long k) const
    {
        const char *p = data + k * width;
        switch (kind == 'f' ? 10 + width : kind == 'i' ? 20 + width : width) {
        case 14: return T(as<float>(p));
        case 18: return T(as<double>(p));
        case 21: return T(as<std::int8_t>(p));
        case 24: return T(as<std::int32_t>(p));
        case 28: return T(as<std::int64_t>(p));
        case 1: return T(as<std::uint8_t>(p));
        case 4: return T(as<std::uint32_t>(p));
        case 8: return T(as<std::uint64_t>(p));
        }
        throw std::runtime_error("an array of a type that this reader does not know");
    }

private:
    template <class S> static S as(const char *p)
    {
        S value;
        std::memcpy(&value, p, sizeof value);
        return value;
    }
};

/* The arrays of one case by name: "position", "smoothing.support_radius", "before/density", "answer/density". */
class Case {
public:
    std::string name;
    std::map<std::string, Entry> arrays;
    std::shared_ptr<std::string> bytes; /* of the file */

    bool has(const std::string &array) const { return arrays.count(array) > 0; } /* an argument that has none is None */

    const Entry &entry(const std::string &array) const
    {
        const auto found = arrays.find(array);
        if (found == arrays.end())
            throw std::runtime_error(name + " has no " + array);
        return found->second;
    }

    long rows(const std::string &array) const { return entry(array).shape.empty() ? 1 : entry(array).shape[0]; }

    template <class T> std::vector<T> get(const std::string &array) const
    {
        const Entry &e = entry(array);
        std::vector<T> values(e.count());
        for (long k = 0; k < e.count(); k++)
            values[k] = e.at<T>(k);
        return values;
    }

    template <class T> T number(const std::string &array) const { return entry(array).at<T>(0); }

    /* Error of each row (the length of its difference) over its bound; where the answer has a NaN, yours must, too. */
    template <class T> Worst compare(const std::string &output, const std::vector<T> &mine) const
    {
        const Entry &answer = entry("answer/" + output), &bound = entry("bound/" + output);
        Worst worst = {0, -1, rows("answer/" + output)};
        const long wide = worst.rows ? answer.count() / worst.rows : 1;
        if (long(mine.size()) != answer.count())
            throw std::runtime_error(output + " of " + name + " has another number of entries");
        for (long i = 0; i < worst.rows; i++) {
            double squares = 0;
            bool known = true, finite = true;
            for (long k = i * wide; k < (i + 1) * wide; k++) {
                const double right = answer.at<double>(k), difference = double(mine[k]) - right;
                squares += difference * difference;
                known = known && !std::isnan(right);
                finite = finite && std::isfinite(double(mine[k]));
            }
            const double allowed = bound.at<double>(i), infinite = std::numeric_limits<double>::infinity();
            double error = known ? std::sqrt(squares) : finite ? infinite : 0;
            if (std::isinf(allowed))
                error = 0;
            else if (!(error == 0))
                error = std::isfinite(error) && allowed > 0 ? error / allowed : infinite;
            if (error > worst.error) {
                worst.error = error;
                worst.row = i;
            }
        }
        return worst;
    }

    /* T4, at most 1 where it holds: the sum of m a ("linear_momentum") or m (x - mean x) x a ("angular_momentum") over
     * the case's invariant/NAME; for "dissipation" 0 where the sum of m a . v is negative. */
    template <class T> double invariant(const std::string &kept, const std::vector<T> &acceleration) const
    {
        const std::vector<double> x = get<double>("position"), v = get<double>("velocity"), m = get<double>("mass");
        double mean[3] = {0, 0, 0}, total[3] = {0, 0, 0}, power = 0;
        for (std::size_t k = 0; k < x.size(); k++)
            mean[k % 3] += x[k] / m.size();
        for (std::size_t i = 0; i < m.size(); i++)
            for (int c = 0; c < 3; c++) {
                const int d = (c + 1) % 3, e = (c + 2) % 3;
                const double a = acceleration[3 * i + c], b = acceleration[3 * i + d], f = acceleration[3 * i + e];
                power += m[i] * a * v[3 * i + c];
                total[c] += kept == "linear_momentum" ? m[i] * a
                                                      : m[i] * ((x[3 * i + d] - mean[d]) * f - (x[3 * i + e] - mean[e]) * b);
            }
        if (kept == "dissipation")
            return power < 0 ? 0 : std::numeric_limits<double>::infinity();
        const double size = std::sqrt(total[0] * total[0] + total[1] * total[1] + total[2] * total[2]);
        return size / number<double>("invariant/" + kept);
    }
};

/* Whether two answers of your code have the same bits: call it several times with the same inputs (T6). */
template <class T> bool same_bits(const std::vector<T> &one, const std::vector<T> &other)
{
    return one.size() == other.size() && std::memcmp(one.data(), other.data(), one.size() * sizeof(T)) == 0;
}

/* A file of vectors: a zip file of npy files that are not compressed. */
class Vectors {
public:
    explicit Vectors(const std::string &path)
    {
        std::ifstream stream(path, std::ios::binary);
        if (!stream)
            throw std::runtime_error("there is no file " + path);
        auto bytes = std::make_shared<std::string>(std::istreambuf_iterator<char>(stream), std::istreambuf_iterator<char>());
        const std::size_t end = bytes->rfind("PK\5\6"); /* of the zip file's directory */
        if (end == std::string::npos)
            throw std::runtime_error(path + " is no npz file");
        const char *start = bytes->data(), *head = start + word(start + end + 16, 4);
        for (long left = word(start + end + 10, 2); left > 0; left--) {
            const long named = word(head + 28, 2);
            const std::string name(head + 46, named - 4); /* without .npy */
            const char *local = start + word(head + 42, 4);
            const char *npy = local + 30 + word(local + 26, 2) + word(local + 28, 2);
            const std::size_t slash = name.find('/');
            if (found.empty() || found.back().name != name.substr(0, slash)) {
                found.push_back(Case());
                found.back().name = name.substr(0, slash);
                found.back().bytes = bytes;
            }
            found.back().arrays[name.substr(slash + 1)] = entry(npy);
            head += 46 + named + word(head + 30, 2) + word(head + 32, 2);
        }
    }

    const std::vector<Case> &cases() const { return found; }

private:
    std::vector<Case> found;

    static long word(const char *p, int size)
    {
        unsigned long value = 0;
        for (int k = size - 1; k >= 0; k--)
            value = value << 8 | (unsigned char)p[k];
        return long(value);
    }

    static Entry entry(const char *npy)
    {
        const long length = word(npy + 8, 2);
        const std::string head(npy + 10, length);
        const std::size_t type = head.find("'descr': '") + 11;
        Entry made = {npy + 10 + length, head[type], head[type + 1] - '0', {}};
        for (std::size_t k = head.find("'shape': (") + 10; head[k] != ')'; k++)
            if (std::isdigit((unsigned char)head[k])) {
                std::size_t digits = 0;
                made.shape.push_back(std::stol(head.substr(k), &digits));
                k += digits - 1;
            }
        return made;
    }
};

} // namespace refsim
#endif

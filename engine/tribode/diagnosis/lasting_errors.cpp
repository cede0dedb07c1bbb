#include "tribode/diagnosis/lasting_errors.hpp"
#include "tribode/diagnosis/normal_equations.hpp"

#include <Eigen/Cholesky>
#include <Eigen/QR>

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <utility>

namespace tribode {
namespace {

// A motion of variance one in D states, of which the first is seen [Hartikainen 2010].
template <int D>
struct LastingMotion {
    Eigen::Matrix<double, D, D> step, covariance; // over one sample; of the states

    explicit LastingMotion(double lasts) {
        const double rate = 1 / lasts, forgotten = std::exp(-rate);
        if constexpr (D == 1) {
            step << forgotten;
            covariance << 1;
        } else {
            step << forgotten * (1 + rate), forgotten, -forgotten * rate * rate, forgotten * (1 - rate);
            covariance << 1, 0, 0, rate * rate;
        }
    }
};

// As ErrorModel::whitened(), for noise of variance one. Returns the logarithm of the determinant of the errors' covariance.
template <int D>
double whiten(const Eigen::MatrixXd& signals, const std::vector<std::size_t>& rows, const LastingMotion<D>& motion,
              double ratio, Eigen::MatrixXd& whitened) {
    using States = Eigen::Matrix<double, D, D>;
    const States begin = ratio * motion.covariance;
    const States noise = begin - motion.step * begin * motion.step.transpose();
    double log_determinant = 0;
    Eigen::Index k = 0;
    for (const std::size_t count : rows) {
        States covariance = begin;
        Eigen::Matrix<double, Eigen::Dynamic, D> states =
            Eigen::Matrix<double, Eigen::Dynamic, D>::Zero(signals.rows(), D);
        for (const Eigen::Index end = k + static_cast<Eigen::Index>(count); k < end; ++k) {
            const double variance = covariance(0, 0) + 1;
            const Eigen::Matrix<double, D, 1> gain = motion.step * covariance.col(0) / variance;
            auto innovation = whitened.col(k);
            innovation = signals.col(k) - states.col(0);
            states = states * motion.step.transpose() + innovation * gain.transpose();
            covariance =
                (motion.step * covariance * motion.step.transpose() + noise - variance * gain * gain.transpose())
                    .eval();
            innovation /= std::sqrt(variance);
            log_determinant += std::log(variance);
        }
    }
    return log_determinant;
}

double whiten(const Eigen::MatrixXd& signals, const std::vector<std::size_t>& rows, const ErrorModel& model,
              Eigen::MatrixXd& whitened) {
    if (model.ratio == 0) {
        whitened = signals;
        return 0;
    }
    return model.is_smooth ? whiten(signals, rows, LastingMotion<2>(model.lasts), model.ratio, whitened)
                           : whiten(signals, rows, LastingMotion<1>(model.lasts), model.ratio, whitened);
}

// What the errors of an output say about the parameters, if they are of one kind.
struct KindOfErrors {
    ErrorModel model;
    double log_likelihood;
    Eigen::MatrixXd information; // inverse of the covariance
    Eigen::VectorXd pull;        // information times the step
};

std::vector<KindOfErrors> kinds_of(const OutputErrors& output, const Eigen::RowVectorXd& scale) {
    // Orthonormal columns in place of the slopes.
    Eigen::ColPivHouseholderQR<Eigen::MatrixXd> split(output.slopes * scale.asDiagonal());
    split.setThreshold(1e-10);
    const Eigen::Index p = split.rank(), n = output.slopes.rows();
    Eigen::MatrixXd signals(p + 1, n);
    signals.topRows(p) = (split.householderQ() * Eigen::MatrixXd::Identity(n, p)).transpose();
    signals.row(p) = output.errors.transpose();
    const Eigen::MatrixXd combined = signals.topRows(p) * output.slopes * scale.asDiagonal();
    const double free = static_cast<double>(std::max<Eigen::Index>(1, n - p));

    std::vector<KindOfErrors> all;
    Eigen::MatrixXd whitened(p + 1, n);
    const auto add = [&](ErrorModel model) {
        const double log_determinant = whiten(signals, output.rows, model, whitened);
        const Eigen::MatrixXd products = whitened * whitened.transpose(), slopes = products.topLeftCorner(p, p);
        const Eigen::VectorXd with = products.col(p).head(p);
        const Eigen::LLT<Eigen::MatrixXd> followed(slopes);
        model.variance = (products(p, p) - with.dot(followed.solve(with))) / free;
        const double log_of_followed = 2 * followed.matrixLLT().diagonal().array().log().sum();
        if (!(model.variance > 0) || !std::isfinite(log_of_followed)) return;
        all.push_back({model, -(free * std::log(model.variance) + log_determinant + log_of_followed) / 2,
                       combined.transpose() * slopes * combined / model.variance,
                       combined.transpose() * with / model.variance});
    };
    add({});
    if (n < 2 * p + 10) return all; // too few to tell how they follow each other
    // Sizes by the density of slow motion over that of the noise: what lasts too long to be seen then is at most as large as
    // what would just be seen. What lasts longer than a third of a record is a part of its mean and its slope.
    const auto longest = static_cast<double>(*std::ranges::max_element(output.rows));
    for (double lasts = 2; lasts < longest / 3; lasts *= 4) {
        for (double density = 1; density < 1e7; density *= 10) {
            add({false, lasts, density / (2 * lasts)});
            add({true, lasts, density / (4 * lasts)});
        }
    }
    return all;
}

// Kinds of errors by their likelihoods: each has an interval between 0 and 1 that is as long as its share of all.
class Draw {
  public:
    explicit Draw(std::vector<KindOfErrors> kinds) : kinds_(std::move(kinds)) {
        const double largest = std::ranges::max_element(kinds_, {}, &KindOfErrors::log_likelihood)->log_likelihood;
        double sum = 0;
        for (const auto& one : kinds_) shares_.push_back(sum += std::exp(one.log_likelihood - largest));
        for (double& share : shares_) share /= sum;
    }
    const ErrorModel& likeliest() const {
        return std::ranges::max_element(kinds_, {}, &KindOfErrors::log_likelihood)->model;
    }
    const KindOfErrors& at(double share) const {
        const auto place = std::ranges::upper_bound(shares_, share) - shares_.begin();
        return kinds_[std::min(static_cast<std::size_t>(place), kinds_.size() - 1)];
    }

  private:
    std::vector<KindOfErrors> kinds_;
    std::vector<double> shares_;
};

} // namespace

Eigen::MatrixXd ErrorModel::whitened(const Eigen::MatrixXd& signals, const std::vector<std::size_t>& rows) const {
    Eigen::MatrixXd result(signals.rows(), signals.cols());
    whiten(signals, rows, *this, result);
    return result / std::sqrt(variance);
}

// What outputs whose errors are alike tell less than one by one: what one force moves is no news in another output. By the correlation
// at each sample, of outputs that were measured at the same ones.
static Eigen::MatrixXd covariance_of_likeness(const std::vector<OutputErrors>& outputs,
                                              const std::vector<ErrorModel>& models, const Eigen::RowVectorXd& scale) {
    const Eigen::Index size = scale.size();
    if (outputs.size() == 1) return Eigen::MatrixXd::Zero(size, size);
    std::vector<Eigen::MatrixXd> slopes;
    std::vector<Eigen::RowVectorXd> errors;
    Eigen::MatrixXd information = Eigen::MatrixXd::Zero(size, size), together = information;
    for (std::size_t o = 0; o < outputs.size(); ++o) {
        slopes.push_back(models[o].whitened((outputs[o].slopes * scale.asDiagonal()).transpose(), outputs[o].rows));
        errors.emplace_back(models[o].whitened(outputs[o].errors.transpose(), outputs[o].rows));
        information += slopes[o] * slopes[o].transpose();
        for (std::size_t other = 0; other < o; ++other) {
            if (outputs[other].rows != outputs[o].rows) continue;
            const double sizes = errors[o].norm() * errors[other].norm();
            const double alike = sizes > 0 ? errors[o].dot(errors[other]) / sizes : 0;
            const Eigen::MatrixXd products = alike * slopes[o] * slopes[other].transpose();
            together += products + products.transpose();
        }
    }
    const Eigen::MatrixXd inverse = bounded_inverse(information);
    return inverse * together * inverse;
}

GeneralizedFit generalized_fit(const std::vector<OutputErrors>& outputs) {
    const Eigen::Index size = outputs.front().slopes.cols();
    GeneralizedFit result{Eigen::VectorXd::Zero(size), Eigen::MatrixXd::Zero(size, size), {}};
    result.models.resize(outputs.size());
    Eigen::RowVectorXd norm = Eigen::RowVectorXd::Zero(size);
    for (const auto& output : outputs) norm += output.slopes.colwise().squaredNorm();
    const Eigen::RowVectorXd scale =
        norm.unaryExpr([](double square) { return square > 0 ? 1 / std::sqrt(square) : 0; });
    std::vector<Draw> draws;
    for (std::size_t o = 0; o < outputs.size(); ++o) {
        if (outputs[o].errors.size() == 0 || !(outputs[o].errors.squaredNorm() > 0)) continue;
        auto kinds = kinds_of(outputs[o], scale);
        if (kinds.empty()) continue;
        draws.emplace_back(std::move(kinds));
        result.models[o] = draws.back().likeliest();
    }
    if (draws.empty() || !(scale.maxCoeff() > 0)) return result;

    // The outputs' kinds are independent: each draw combines others of them.
    constexpr int count = 64;
    constexpr double golden = 0.6180339887498949;
    Eigen::MatrixXd squares = Eigen::MatrixXd::Zero(size, size);
    for (int d = 0; d < count; ++d) {
        Eigen::MatrixXd information = Eigen::MatrixXd::Zero(size, size);
        Eigen::VectorXd pull = Eigen::VectorXd::Zero(size);
        double share = (d + 0.5) / count;
        for (const Draw& draw : draws) {
            const KindOfErrors& one = draw.at(share);
            information += one.information;
            pull += one.pull;
            share = std::fmod(share * count * golden, 1);
        }
        const Eigen::MatrixXd inverse = bounded_inverse(information);
        const Eigen::VectorXd step = inverse * pull;
        result.step += step / count;
        squares += step * step.transpose() / count;
        result.covariance += inverse / count;
    }
    // The mean of the covariances, and that of the means.
    result.covariance += squares - result.step * result.step.transpose();
    result.covariance += covariance_of_likeness(outputs, result.models, scale);
    result.step = scale.asDiagonal() * result.step;
    result.covariance = scale.asDiagonal() * result.covariance * scale.asDiagonal();
    return result;
}

} // namespace tribode
